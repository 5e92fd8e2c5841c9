//! The one integration test binary; see each module.

mod meshes;
