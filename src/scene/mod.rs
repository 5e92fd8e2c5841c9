//! WHAT is rendered: plain, validated data in f64. Knows no file and no renderer.
//!
//! Everything here is in *world space* (scene units, right-handed, the scene file's axes) unless a name says otherwise.
//! Truth is a sum of terms ([`Scene`]'s fields), of which particles are the first; what is absent costs nothing.

pub mod camera;
pub mod kernel;
pub mod mesh;
pub mod particles;
pub mod stereo;

pub use camera::{Camera, View};
pub use kernel::Kernel;
pub use mesh::Mesh;
pub use particles::{Attribute, ParticleSet};
pub use stereo::{Eye, Stereo, StereoMode};

/// Linear-light RGB with sRGB (BT.709) primaries, not clamped.
pub type Rgb = [f32; 3];

/// All that a picture is made of.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The cyclopean camera.
    pub camera: Camera,
    /// The stereo rig; absent: one view from the camera itself.
    pub stereo: Option<Stereo>,
    /// What a ray sees that meets nothing else.
    pub background: Rgb,
    /// Gas, the first term of the extinction. A particle's index, which breaks ties of the drawing order, counts
    /// through the sets in this order.
    pub particles: Vec<ParticleSet>,
    /// Opaque surfaces.
    pub meshes: Vec<Mesh>,
}

impl Scene {
    /// The views of the scene: left and right with a stereo rig, else the camera's own.
    pub fn views(&self) -> Vec<View> {
        stereo::views(&self.camera, self.stereo.as_ref())
    }

    /// Number of particles in all sets.
    pub fn particle_count(&self) -> usize {
        self.particles.iter().map(ParticleSet::len).sum()
    }
}
