//! FROM WHERE: scene files, particle files, mesh files.

pub mod color_map;
pub mod mesh;
pub mod particles;
pub mod profile;
pub mod scene_file;
