//! The one integration test binary; see each module.

mod harness;
mod laws;
// mod methods;
mod truth;
