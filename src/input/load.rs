//! From a scene file's entries to a scene: reads everything the file refers to.

use super::mesh::load_mesh_noting;
use super::particles::particle_set;
use super::scene_file::SceneFile;
use crate::error::Result;
use crate::render::{Progress, Settings, plan};
use crate::scene::Scene;

/// A scene with the settings it is to be rendered with.
#[derive(Clone, Debug)]
pub struct SceneInput {
    /// What is rendered.
    pub scene: Scene,
    /// How.
    pub settings: Settings,
    /// What the user should know, one sentence each.
    pub notes: Vec<String>,
}

/// Reads the particle and mesh files of a scene file. Progress is told of each particle file by itself, in bytes.
///
/// # Errors
/// [`crate::Error::Input`] for the first file, in the scene file's order, that cannot be used.
pub fn load_scene(file: SceneFile, progress: &dyn Progress) -> Result<SceneInput> {
    let mut notes = file.notes;
    let mut particles = Vec::with_capacity(file.particles.len());
    for (i, entry) in file.particles.iter().enumerate() {
        particles.push(particle_set(entry, &format!("[[particles]] {}", i + 1), progress, &mut notes)?);
    }
    let meshes = file.meshes.iter().map(|entry| load_mesh_noting(entry, &mut notes)).collect::<Result<Vec<_>>>()?;
    let scene = Scene { camera: file.camera, stereo: file.stereo, background: file.background, particles, meshes };
    notes.extend(plan::notes(&scene, &file.settings));
    Ok(SceneInput { scene, settings: file.settings, notes })
}
