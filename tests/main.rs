//! The one integration test binary; see each module.

mod files;
mod pictures;
mod scene_file;
