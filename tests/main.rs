//! The one integration test binary; see each module.

// Clippy's exemption knows the functions marked as tests alone, not what they call.
#![allow(clippy::unwrap_used)]

mod harness;
mod laws;
// mod methods;
mod truth;
