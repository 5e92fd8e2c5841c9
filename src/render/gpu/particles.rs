//! The particles of a scene on the device, kept from frame to frame while they are the same.

use super::Gpu;
use super::device::Growing;
use super::layout::{Kind, Particle, parts};
use super::steps::{Slice, filled};
use crate::render::OpacityModel;
use crate::render::cpu::engine::Job;
use crate::scene::{Attribute, ParticleSet, Scene};
use glam::DVec3;
use rayon::prelude::*;

/// Particles that are looked at by one thread at a time.
const CHUNK: usize = 1 << 14;

/// What was uploaded last, and where it is.
#[derive(Default)]
pub(super) struct Kept {
    buffer: Growing,
    kinds: Growing,
    uploaded: Option<Uploaded>,
}

struct Uploaded {
    sets: Vec<ParticleSet>,
    model: OpacityModel,
    faintest: f64,
    range: Range,
    slice: Slice,
}

/// A scene against what was uploaded last.
#[derive(Clone, Copy)]
pub(super) struct Look {
    pub range: Range,
    /// Whether its particles are there.
    kept: bool,
}

/// Where particles are, and how large.
#[derive(Clone, Copy)]
pub(super) struct Range {
    low: DVec3,
    high: DVec3,
    /// Least and greatest radius.
    pub radii: [f64; 2],
}

impl Range {
    const NONE: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, radii: [f64::INFINITY, 0.0] };

    /// The range of a scene.
    pub fn new(scene: &Scene) -> Self {
        let chunks =
            scene.particles.iter().flat_map(|set| (0..set.len()).step_by(CHUNK).map(move |first| (set, first)));
        let of_chunk = |(set, first): (&ParticleSet, usize)| {
            let mut range = Self::NONE;
            for i in first..set.len().min(first + CHUNK) {
                let point = DVec3::new(set.x[i], set.y[i], set.z[i]);
                let radius = set.radius.get(i);
                range = range.and(Self { low: point, high: point, radii: [radius; 2] });
            }
            range
        };
        chunks.collect::<Vec<_>>().into_par_iter().map(of_chunk).reduce(|| Self::NONE, Self::and)
    }

    fn and(self, other: Self) -> Self {
        let radii = [self.radii[0].min(other.radii[0]), self.radii[1].max(other.radii[1])];
        Self { low: self.low.min(other.low), high: self.high.max(other.high), radii }
    }

    /// The middle, which coordinates on the device are about.
    pub fn middle(&self) -> DVec3 {
        // Halved first: no sum overflows.
        self.low * 0.5 + self.high * 0.5
    }

    /// Largest coordinate about the middle.
    pub fn reach(&self) -> f64 {
        (self.high * 0.5 - self.low * 0.5).max_element()
    }
}

impl Kept {
    /// What is to be known before anything is uploaded.
    pub fn look(&self, job: &Job) -> Look {
        let sets = &job.scene.particles;
        let (model, faintest) = (job.model, job.options.faintest);
        if let Some(last) = &self.uploaded
            && last.model == model
            && last.faintest == faintest
            && last.sets.len() == sets.len()
            && last.sets.iter().zip(sets).all(|(a, b)| same(a, b))
        {
            return Look { range: last.range, kept: true };
        }
        Look { range: Range::new(job.scene), kept: false }
    }

    /// Uploads what is not there yet; returns particles and kinds, which fit into buffers.
    pub fn upload(&mut self, gpu: &Gpu, job: &Job, Look { range, kept }: Look) -> (Slice, Slice) {
        let kinds = filled(&mut self.kinds, gpu, bytemuck::cast_slice(&kinds(job)));
        if let Some(last) = self.uploaded.as_ref().filter(|_| kept) {
            return (last.slice.clone(), kinds);
        }
        let slice = filled(&mut self.buffer, gpu, bytemuck::cast_slice(&packed(job, range.middle())));
        let (sets, model, faintest) = (job.scene.particles.clone(), job.model, job.options.faintest);
        self.uploaded = Some(Uploaded { sets, model, faintest, range, slice: slice.clone() });
        (slice, kinds)
    }
}

/// Whether two sets upload the same, but for their kernels, which are no part of the particles.
fn same(a: &ParticleSet, b: &ParticleSet) -> bool {
    let places = [(&a.x, &b.x), (&a.y, &b.y), (&a.z, &b.z)].iter().all(|(a, b)| equal(a, b));
    places
        && same_attribute(&a.radius, &b.radius)
        && same_attribute(&a.opacity, &b.opacity)
        && same_attribute(&a.color, &b.color)
}

fn same_attribute<T: PartialEq + Sync>(a: &Attribute<T>, b: &Attribute<T>) -> bool {
    match (a, b) {
        (Attribute::Uniform(a), Attribute::Uniform(b)) => a == b,
        (Attribute::Each(a), Attribute::Each(b)) => equal(a, b),
        (Attribute::Uniform(_), Attribute::Each(_)) | (Attribute::Each(_), Attribute::Uniform(_)) => false,
    }
}

/// Whether two lists are equal.
fn equal<T: PartialEq + Sync>(a: &[T], b: &[T]) -> bool {
    a.len() == b.len() && a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).all(|(a, b)| a == b)
}

fn packed(job: &Job, middle: DVec3) -> Vec<Particle> {
    let mut particles = vec![Particle::default(); job.scene.particle_count()];
    let mut rest = &mut particles[..];
    for (number, set) in job.scene.particles.iter().enumerate() {
        let (mine, others) = rest.split_at_mut(set.len());
        rest = others;
        mine.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(i, particle)| {
            let point = DVec3::new(set.x[i], set.y[i], set.z[i]) - middle;
            let [x, y, z] = point.to_array().map(parts);
            let [radius, radius_low] = parts(set.radius.get(i));
            let opacity = set.opacity.get(i);
            let amplitude = if opacity <= job.options.faintest { 0.0 } else { job.factor(number, opacity)[0] };
            let high = [x[0], y[0], z[0]];
            let low = [x[1], y[1], z[1]];
            *particle = Particle { high, radius, low, radius_low, color: set.color.get(i), amplitude };
        });
    }
    particles
}

/// One per set; empty ones begin where the next does.
fn kinds(job: &Job) -> Vec<Kind> {
    let mut start = 0;
    let sets = job.scene.particles.iter().enumerate();
    sets.map(|(number, set)| {
        let table = job.table(number);
        let kind = Kind { start, table: table.start(), intervals: table.intervals() };
        start += set.len() as u32;
        kind
    })
    .collect()
}
