//! The one integration test binary; see each module.

// Clippy's exemption knows the functions marked as tests alone, not what they call.
#![allow(clippy::unwrap_used)]

mod allocation;
mod auto;
mod chart;
mod cli;
mod error_surface;
mod files;
mod gpu;
mod harness;
mod laws;
mod layers;
mod mesh_files;
mod meshes;
mod methods;
mod mutations;
mod npy;
mod pictures;
mod plot;
mod reference;
mod scene_file;
mod sheet;
mod slab;
mod spherical;
mod splats;
mod stability;
mod truth;
mod vdb;
mod verify;
mod volume;
mod vtk;
