//! An independent renderer of the billboard methods and of spherical billboards: one f64 ray per sample, every particle tried on every ray.
//!
//! It reads the raw fields of the scene and nothing else: its camera, its stereo rig, its footprints and its ray-triangle
//! caster are its own, so that a mistake in the library's cannot hide. Speed is of no concern, clarity is.

use libm::erf;
use stereomist::scene::{Kernel, Mesh, Scene, StereoMode};

type V3 = [f64; 3];

fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn mad(a: V3, s: f64, b: V3) -> V3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: V3) -> V3 {
    let length = dot(a, a).sqrt();
    a.map(|v| v / length)
}

/// The method to render with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    Viewplane,
    Viewpoint,
    Perspective,
    Spherical(Balls),
}

/// Spherical billboards, and what can be otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Balls {
    pub integrated: bool,
    pub perspective: bool,
    /// The quad stands at the centre's depth and not at the farthest point.
    pub centred: bool,
}

/// One eye: where it stands and its right, up and forward directions, in world space.
#[derive(Clone, Debug)]
pub struct Pinhole {
    eye: V3,
    right: V3,
    up: V3,
    forward: V3,
    /// Added to the x of every ray direction.
    shift: f64,
    tangent: [f64; 2],
    pub size: [usize; 2],
    samples: usize,
    pub near: f64,
    /// The cyclopean eye.
    lamp: V3,
}

/// The signed offsets of a scene's eyes along camera x, in the order of its views.
pub fn eye_offsets(scene: &Scene) -> Vec<f64> {
    match &scene.stereo {
        Some(stereo) => vec![-0.5 * stereo.interocular, 0.5 * stereo.interocular],
        None => vec![0.0],
    }
}

impl Pinhole {
    /// The eye at `offset` along camera x.
    pub fn new(scene: &Scene, offset: f64) -> Self {
        let camera = &scene.camera;
        let lamp = camera.position.to_array();
        let forward = unit(sub(camera.look_at.to_array(), lamp));
        let right = unit(cross(forward, camera.up.to_array()));
        let up = cross(right, forward);
        let eye = mad(lamp, offset, right);
        let tall = (0.5 * camera.fov_y).tan();
        let size = camera.size.map(|n| n as usize);
        let mut pinhole = Self {
            eye,
            right,
            up,
            forward,
            shift: 0.0,
            tangent: [tall * size[0] as f64 / size[1] as f64, tall],
            size,
            samples: camera.samples as usize,
            near: camera.near,
            lamp,
        };
        let convergence = scene.stereo.as_ref().and_then(|s| s.convergence.map(|plane| (s.mode, plane)));
        match convergence {
            Some((StereoMode::Parallel, plane)) => pinhole.shift = -offset / plane,
            Some((StereoMode::ToeIn, plane)) => {
                pinhole.forward = unit(sub(mad(lamp, plane, forward), eye));
                pinhole.right = unit(cross(pinhole.forward, up));
                pinhole.up = cross(pinhole.right, pinhole.forward);
            }
            None => {}
        }
        pinhole
    }

    /// Camera space: right, up, backward.
    pub fn enter(&self, world: V3) -> V3 {
        let p = sub(world, self.eye);
        [dot(p, self.right), dot(p, self.up), -dot(p, self.forward)]
    }

    pub fn columns(&self) -> usize {
        self.size[0] * self.samples
    }

    pub fn rows(&self) -> usize {
        self.size[1] * self.samples
    }

    /// Camera-space direction, z = -1, through the centre of a sample.
    pub fn ray(&self, column: usize, row: usize) -> V3 {
        let x_ndc = (2 * column + 1) as f64 / self.columns() as f64 - 1.0;
        let y_ndc = 1.0 - (2 * row + 1) as f64 / self.rows() as f64;
        [x_ndc * self.tangent[0] + self.shift, y_ndc * self.tangent[1], -1.0]
    }
}

/// Opaque surfaces by sample.
pub struct Opaque {
    /// Depth, infinite where the ray meets no surface.
    pub depth: Vec<f64>,
    pub color: Vec<V3>,
    /// Samples next to whose ray an edge or another surface passes within rounding.
    pub fragile: Vec<bool>,
}

/// Shoots every ray at every triangle: the nearest hit beyond the near plane, Lambert |n.l| with the lamp at the cyclopean
/// eye. None without meshes. Knows no textures.
pub fn cast(scene: &Scene, pinhole: &Pinhole) -> Option<Opaque> {
    if scene.meshes.is_empty() {
        return None;
    }
    let count = pinhole.columns() * pinhole.rows();
    let mut opaque =
        Opaque { depth: vec![f64::INFINITY; count], color: vec![[0.0; 3]; count], fragile: vec![false; count] };
    for i in 0..count {
        let ray = pinhole.ray(i % pinhole.columns(), i / pinhole.columns());
        // The same direction in world space, scaled so that the ray parameter is the depth.
        let direction = mad(mad(pinhole.forward, ray[0], pinhole.right), ray[1], pinhole.up);
        for mesh in &scene.meshes {
            for (triangle, corners) in mesh.corners.iter().enumerate() {
                let [a, b, c] = corners.map(|k| mesh.positions[k as usize].to_array());
                let normal = cross(sub(b, a), sub(c, a));
                let facing = dot(normal, direction);
                if facing == 0.0 {
                    continue;
                }
                let depth = dot(normal, sub(a, pinhole.eye)) / facing;
                let hit = mad(pinhole.eye, depth, direction);
                let area = dot(normal, normal);
                let weights = [(b, c), (c, a), (a, b)].map(|(p, q)| dot(cross(sub(q, p), sub(hit, p)), normal) / area);
                let inside = weights.iter().copied().fold(f64::INFINITY, f64::min);
                let close = (depth - opaque.depth[i]).abs() < 1e-9 * depth.abs();
                let first = depth > pinhole.near && depth < opaque.depth[i];
                opaque.fragile[i] |= depth > 0.0 && inside.abs() < 1e-9 && depth < opaque.depth[i] * (1.0 + 1e-9);
                opaque.fragile[i] |= inside >= 0.0 && close;
                if first && inside >= 0.0 {
                    opaque.depth[i] = depth;
                    opaque.color[i] = shade(mesh, triangle, weights, hit, unit(normal), pinhole.lamp);
                }
            }
        }
    }
    Some(opaque)
}

fn shade(mesh: &Mesh, triangle: usize, weights: V3, hit: V3, flat: V3, lamp: V3) -> V3 {
    let material = &mesh.materials[mesh.triangle_materials[triangle] as usize];
    assert!(material.texture.is_none(), "the caster knows no textures");
    let corners = mesh.corners[triangle].map(|k| k as usize);
    let blend =
        |values: [V3; 3]| mad(mad(values[0].map(|v| v * weights[0]), weights[1], values[1]), weights[2], values[2]);
    let mut color = material.color.map(f64::from);
    if !mesh.colors.is_empty() {
        let vertex = blend(corners.map(|k| mesh.colors[k].map(f64::from)));
        color = [color[0] * vertex[0], color[1] * vertex[1], color[2] * vertex[2]];
    }
    if material.unlit {
        return color;
    }
    let normal = if mesh.normals.is_empty() { flat } else { unit(blend(corners.map(|k| mesh.normals[k].to_array()))) };
    let cosine = dot(normal, unit(sub(lamp, hit))).abs();
    color.map(|v| v * cosine)
}

/// F(u), written from the formulas and not from the library's.
fn footprint(kernel: &Kernel, u: f64) -> f64 {
    if u >= 1.0 {
        return 0.0;
    }
    let half = (1.0 - u * u).sqrt();
    match kernel {
        Kernel::Gaussian => (-4.5 * u * u).exp() * erf(3.0 * half / 2f64.sqrt()) / erf(3.0 / 2f64.sqrt()),
        Kernel::Beliaev => (-8.0 * u * u).exp() * erf(8f64.sqrt() * half) / erf(8f64.sqrt()),
        Kernel::Linear if u == 0.0 => 1.0,
        Kernel::Linear => half - u * u * ((1.0 + half) / u).ln(),
        Kernel::Constant => half,
        Kernel::Poly => half.powi(5),
        Kernel::Table(profile) => {
            chord_by_parts(profile.q(), profile.densities(), u) / chord_by_parts(profile.q(), profile.densities(), 0.0)
        }
    }
}

/// Chord integral of a profile by parts: 2 k(1) sqrt(1 - u^2) - 2 times the integral of k'(q) sqrt(q^2 - u^2) over q.
fn chord_by_parts(q: &[f64], k: &[f64], u: f64) -> f64 {
    let primitive = |q: f64| {
        let leg = (q * q - u * u).max(0.0).sqrt();
        let tail = if u > 0.0 { u * u * ((q + leg) / u).ln() } else { 0.0 };
        0.5 * (q * leg - tail)
    };
    let mut chord = 2.0 * k[k.len() - 1] * (1.0 - u * u).sqrt();
    for i in 1..q.len() {
        if q[i] > u {
            let slope = (k[i] - k[i - 1]) / (q[i] - q[i - 1]);
            chord -= 2.0 * slope * (primitive(q[i]) - primitive(q[i - 1].max(u)));
        }
    }
    chord
}

/// The footprint of a billboard at in-plane offsets over the radius, and how close it is to its rim.
fn billboard(kernel: &Kernel, a: f64, b: f64) -> (f64, f64) {
    if *kernel == Kernel::Gaussian {
        let edge = a.abs().max(b.abs());
        let f = if edge < 1.0 { (-4.5 * (a * a + b * b)).exp() } else { 0.0 };
        (f, (edge - 1.0).abs())
    } else {
        let u = (a * a + b * b).sqrt();
        (footprint(kernel, u), (u - 1.0).abs())
    }
}

/// A particle before one eye.
struct Dot<'a> {
    kernel: &'a Kernel,
    centre: V3,
    radius: f64,
    opacity: f64,
    color: V3,
    key: f64,
    /// Plane of the billboard that faces the eye: towards the eye, and the two axes in the plane.
    facing: [V3; 3],
}

/// The true picture.
pub struct Picture {
    pub size: [usize; 2],
    /// Row-major red, green, blue and transmittance.
    pub planes: [Vec<f64>; 4],
    /// Row-major depth of the nearest surface of the samples, infinite where there is none; absent without meshes.
    pub depth: Option<Vec<f64>>,
    /// Pixels where the picture jumps within the rounding of single precision: order of nearly equal keys, cuts at opaque
    /// surfaces, rims of footprints that do not fall to zero gently.
    pub fragile: Vec<bool>,
}

/// Renders one eye. `opaque` holds the opaque surfaces by sample, where there are any.
pub fn render(scene: &Scene, way: Way, linear_opacity: bool, pinhole: &Pinhole, opaque: Option<&Opaque>) -> Picture {
    let dots = arrange(scene, way, pinhole);
    let background = scene.background.map(f64::from);
    let [width, height] = pinhole.size;
    let n = pinhole.samples;
    let mut picture = Picture {
        size: [width, height],
        planes: [0; 4].map(|_| vec![0.0; width * height]),
        depth: opaque.map(|_| vec![f64::INFINITY; width * height]),
        fragile: vec![false; width * height],
    };
    for row in 0..pinhole.rows() {
        for column in 0..pinhole.columns() {
            let ray = pinhole.ray(column, row);
            let sample = row * pinhole.columns() + column;
            let pixel = (row / n) * width + column / n;
            let wall = opaque.map_or(f64::INFINITY, |o| o.depth[sample]);
            let (mut light, mut through) = (background, 1.0);
            if let (Some(opaque), true) = (opaque, wall.is_finite()) {
                (light, through) = (opaque.color[sample], 0.0);
            }
            let mut fragile = opaque.is_some_and(|o| o.fragile[sample]);
            let mut last_key = f64::INFINITY;
            for dot in &dots {
                let Some((f, rim, depth)) = meet(dot, way, ray, [pinhole.near, wall]) else { continue };
                if rim < 1e-5 {
                    fragile = true;
                }
                if f <= 0.0 || dot.opacity == 0.0 {
                    continue;
                }
                if wall.is_finite() && (depth - wall).abs() < 1e-5 * wall {
                    fragile = true;
                }
                if depth >= wall {
                    continue;
                }
                // Equal keys are no risk: the index decides. Nearly equal ones are.
                fragile |= last_key != dot.key && last_key - dot.key < 1e-6 * dot.key.abs();
                last_key = dot.key;
                let linear_opacity = linear_opacity && !matches!(way, Way::Spherical(_));
                let alpha = if linear_opacity { (dot.opacity * f).min(1.0) } else { 1.0 - (1.0 - dot.opacity).powf(f) };
                for (channel, light) in light.iter_mut().enumerate() {
                    *light = *light * (1.0 - alpha) + alpha * dot.color[channel];
                }
                through *= 1.0 - alpha;
            }
            let share = 1.0 / (n * n) as f64;
            for (plane, value) in picture.planes.iter_mut().zip([light[0], light[1], light[2], through]) {
                plane[pixel] += value * share;
            }
            picture.fragile[pixel] |= fragile;
            if let Some(depth) = &mut picture.depth {
                depth[pixel] = depth[pixel].min(wall);
            }
        }
    }
    picture
}

/// The particles beyond the near plane (balls: with their farthest point), farthest first; of equal keys the lower index first.
fn arrange<'a>(scene: &'a Scene, way: Way, pinhole: &Pinhole) -> Vec<Dot<'a>> {
    let mut dots = Vec::new();
    for set in &scene.particles {
        for i in 0..set.x.len() {
            let centre = pinhole.enter([set.x[i], set.y[i], set.z[i]]);
            let depth = -centre[2];
            let reach = if matches!(way, Way::Spherical(_)) { set.radius.get(i) } else { 0.0 };
            if depth + reach <= pinhole.near {
                continue;
            }
            let key = match way {
                Way::Viewplane | Way::Spherical(_) => depth,
                Way::Viewpoint | Way::Perspective => dot(centre, centre).sqrt(),
            };
            dots.push(Dot {
                kernel: &set.kernel,
                centre,
                radius: set.radius.get(i),
                opacity: set.opacity.get(i),
                color: set.color.get(i).map(f64::from),
                key,
                facing: facing(centre),
            });
        }
    }
    // Stable: the order of pushing, by index, decides ties.
    dots.sort_by(|a, b| b.key.total_cmp(&a.key));
    dots
}

/// The billboard through `c` that faces the eye at the origin: n towards it, u* = (0, 1, 0) x (V - C), v = n x u*.
fn facing(c: V3) -> [V3; 3] {
    let toward = c.map(|v| -v);
    let sideways = cross([0.0, 1.0, 0.0], toward);
    let u = if dot(sideways, sideways) == 0.0 { [1.0, 0.0, 0.0] } else { unit(sideways) };
    let n = unit(toward);
    [n, u, cross(n, u)]
}

/// Where a ray meets a particle: footprint, distance from the rim in radii, and the depth that opaque surfaces cut at.
/// `ends` are the depths that the ray's gas lies between, which clip balls.
fn meet(particle: &Dot, way: Way, ray: V3, ends: [f64; 2]) -> Option<(f64, f64, f64)> {
    let (c, r) = (particle.centre, particle.radius);
    match way {
        Way::Viewplane => {
            let depth = -c[2];
            let (f, rim) = billboard(particle.kernel, (ray[0] * depth - c[0]) / r, (ray[1] * depth - c[1]) / r);
            Some((f, rim, depth))
        }
        Way::Viewpoint => {
            let [n, u, v] = particle.facing;
            let depth = dot(c, n) / dot(ray, n);
            if !(depth > 0.0 && depth.is_finite()) {
                return None;
            }
            let offset = mad(c.map(|v| -v), depth, ray);
            let (f, rim) = billboard(particle.kernel, dot(offset, u) / r, dot(offset, v) / r);
            Some((f, rim, depth))
        }
        Way::Perspective => {
            let along = dot(c, ray);
            let reach = dot(ray, ray);
            let distance2 = dot(c, c);
            if along <= 0.0 && distance2 >= r * r {
                return None;
            }
            let perpendicular = cross(c, ray);
            let u = (dot(perpendicular, perpendicular) / reach).sqrt() / r;
            Some((footprint(particle.kernel, u), (u - 1.0).abs(), along / reach))
        }
        // What falls to zero gently at its rim and is clipped by `ends` has no step to be fragile at.
        Way::Spherical(balls) => Some((ball(balls, c, r, ray, ends), f64::INFINITY, f64::NEG_INFINITY)),
    }
}

/// Optical depth over that of the centre's line, of a ball on a ray between two depths.
fn ball(balls: Balls, c: V3, r: f64, ray: V3, [near, wall]: [f64; 2]) -> f64 {
    // Distances along the ray: of the point nearest the centre, of the near plane and of the wall; then how far off the
    // centre the ray passes.
    let (middle, start, end, d) = if balls.perspective {
        let length = dot(ray, ray).sqrt();
        let middle = dot(c, ray) / length;
        let foot = mad(c, -middle / length, ray);
        (middle, near * length, wall * length, dot(foot, foot).sqrt())
    } else {
        let quad = if balls.centred { f64::max(-c[2], near) } else { r - c[2] };
        (-c[2], near, wall, (ray[0] * quad - c[0]).hypot(ray[1] * quad - c[1]))
    };
    if d >= r {
        return 0.0;
    }
    let w = (r * r - d * d).sqrt();
    let (front, back) = (f64::max(start, middle - w), f64::min(end, middle + w));
    if back <= front {
        return 0.0;
    }
    if balls.integrated {
        (linear_primitive(back - middle, d, r) - linear_primitive(front - middle, d, r)) / r
    } else {
        (1.0 - d / r) * (back - front) / (2.0 * r)
    }
}

/// A primitive of 1 - sqrt(u^2 + b^2)/r along u.
pub fn linear_primitive(u: f64, b: f64, r: f64) -> f64 {
    let tail = if b > 0.0 { b * b * (u / b).asinh() } else { 0.0 };
    u - (u * u.hypot(b) + tail) / (2.0 * r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::harness;
    use glam::DVec3;
    use stereomist::scene::mesh::Material;
    use stereomist::scene::{Attribute, Camera, Stereo};

    const WAYS: [Way; 3] = [Way::Viewplane, Way::Viewpoint, Way::Perspective];

    /// Looks down -z from the origin, 90 degrees wide and tall, 3 x 3 pixels: the rays' x and y are -2/3, 0, 2/3.
    fn scene(centres: &[[f64; 3]], radius: f64, opacity: f64) -> Scene {
        Scene {
            camera: Camera {
                position: DVec3::ZERO,
                look_at: DVec3::NEG_Z,
                up: DVec3::Y,
                fov_y: 90f64.to_radians(),
                size: [3, 3],
                near: 0.1,
                samples: 1,
            },
            stereo: None,
            background: [0.0; 3],
            particles: vec![harness::set(Kernel::Gaussian, centres, radius, opacity)],
            meshes: Vec::new(),
        }
    }

    fn wall(z: f64, normals: Vec<DVec3>) -> Mesh {
        let positions = [(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)].map(|(x, y)| DVec3::new(x, y, z)).to_vec();
        Mesh {
            positions,
            normals,
            corners: vec![[0, 1, 2], [0, 2, 3]],
            triangle_materials: vec![0, 0],
            materials: vec![Material { color: [0.5, 0.25, 1.0], texture: None, unlit: false }],
            ..Mesh::default()
        }
    }

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-12, "{a} is not {b}");
    }

    #[test]
    fn centre_pixel_shows_the_opacity_and_side_pixels_the_footprint_of_each_method() {
        let scene = scene(&[[0.0, 0.0, -2.0]], 3.0, 0.4);
        let eye = Pinhole::new(&scene, 0.0);
        for way in WAYS {
            let picture = render(&scene, way, false, &eye, None);
            close(picture.planes[0][4], 0.4);
            close(picture.planes[3][4], 0.6);
            // The ray (2/3, 0, -1) meets the plane z = -2 at x = 4/3, and passes the centre at 2 sin(atan(2/3)).
            let f = match way {
                Way::Viewplane | Way::Viewpoint | Way::Spherical(_) => (-4.5 * (4.0 / 9.0f64).powi(2)).exp(),
                Way::Perspective => {
                    let u = 2.0 / 3.0 * (2.0f64 / 3.0).atan().sin();
                    (-4.5 * u * u).exp() * erf(3.0 * ((1.0 - u * u) / 2.0).sqrt()) / erf(3.0 / 2f64.sqrt())
                }
            };
            close(picture.planes[0][5], 1.0 - 0.6f64.powf(f));
            close(render(&scene, way, true, &eye, None).planes[0][5], 0.4 * f);
        }
    }

    #[test]
    fn of_equal_keys_the_lower_index_is_behind() {
        let mut scene = scene(&[[0.0, 0.0, -2.0]; 2], 3.0, 0.5);
        scene.particles[0].color = Attribute::Each(vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        for way in WAYS {
            let picture = render(&scene, way, false, &Pinhole::new(&scene, 0.0), None);
            close(picture.planes[0][4], 0.25);
            close(picture.planes[1][4], 0.5);
            assert!(!picture.fragile[4]);
        }
    }

    #[test]
    fn the_near_plane_drops_centres_and_walls_hide_what_is_behind() {
        let mut scene = scene(&[[0.0, 0.0, -0.1], [0.0, 0.0, 5.0], [0.0, 0.0, -3.0]], 6.0, 0.5);
        let eye = Pinhole::new(&scene, 0.0);
        for way in WAYS {
            close(render(&scene, way, false, &eye, None).planes[3][4], 0.5);
        }
        for (z, lit) in [(-2.0, false), (-4.0, true)] {
            scene.meshes = vec![wall(z, Vec::new())];
            let opaque = cast(&scene, &eye).unwrap();
            for way in WAYS {
                let picture = render(&scene, way, false, &eye, Some(&opaque));
                close(picture.planes[0][4], if lit { 0.75 } else { 0.5 });
                close(picture.planes[3][4], 0.0);
                close(picture.depth.unwrap()[4], -z);
            }
        }
    }

    #[test]
    fn walls_are_lit_from_the_cyclopean_eye() {
        let mut scene = scene(&[], 1.0, 0.0);
        scene.stereo = Some(Stereo { interocular: 2.0, convergence: None, mode: StereoMode::Parallel });
        assert_eq!(eye_offsets(&scene), [-1.0, 1.0]);
        scene.meshes = vec![wall(-3.0, Vec::new())];
        let opaque = cast(&scene, &Pinhole::new(&scene, 1.0)).unwrap();
        // The ray (2/3, 0, -1) from (1, 0, 0) meets the wall at (3, 0, -3): 45 degrees from the lamp at the origin.
        close(opaque.depth[5], 3.0);
        close(opaque.color[5][0], 0.5 * 0.5f64.sqrt());
        scene.meshes = vec![wall(-3.0, vec![DVec3::new(1.0, 0.0, 0.0); 4])];
        close(cast(&scene, &Pinhole::new(&scene, -1.0)).unwrap().color[3][2], 0.5f64.sqrt());
    }

    #[test]
    fn balls_hold_the_integral_of_their_falloff_between_near_plane_and_wall() {
        let (c, r, ray) = ([0.3, -0.2, -2.0], 1.5, [0.25, 0.1, -1.0]);
        let sum = |ends: [f64; 2]| {
            let count = 200_000;
            let step = (ends[1] - ends[0]) / f64::from(count);
            let at = |i: i32| mad(c.map(|v: f64| -v), ends[0] + (f64::from(i) + 0.5) * step, ray);
            let density = |p: V3| f64::max(0.0, 1.0 - dot(p, p).sqrt() / r);
            (0..count).map(|i| density(at(i))).sum::<f64>() * step * dot(ray, ray).sqrt() / r
        };
        let balls = Balls { integrated: true, perspective: true, centred: false };
        for ends in [[0.01, 9.0], [1.1, 9.0], [0.01, 2.7], [2.4, 2.5], [0.01, 1.0]] {
            assert!((ball(balls, c, r, ray, ends) - sum(ends)).abs() < 1e-8, "{ends:?}");
        }
        // Parallel to z through the quad's point, by hand: 0.2 off the centre on the far quad at depth 3.5.
        let printed = Balls { integrated: false, perspective: false, centred: false };
        let ray = [(0.3 + 0.2) / 3.5, -0.2 / 3.5, -1.0];
        let w = (1.5f64 * 1.5 - 0.04).sqrt();
        close(ball(printed, c, r, ray, [0.01, 99.0]), (1.0 - 0.2 / 1.5) * 2.0 * w / 3.0);
        close(ball(printed, c, r, ray, [1.9, 2.5]), (1.0 - 0.2 / 1.5) * 0.6 / 3.0);
        // Its centre behind the eye, its back before it.
        close(ball(Balls { centred: true, ..printed }, [0.0, 0.0, 1.0], r, [0.0, 0.0, -1.0], [0.1, 9.0]), 0.4 / 3.0);
    }

    #[test]
    fn footprints_start_at_one_and_end_at_zero() {
        for kernel in harness::kernels() {
            close(footprint(&kernel, 0.0), 1.0);
            assert_eq!(footprint(&kernel, 1.0), 0.0);
            assert!(footprint(&kernel, 0.999_999) < 2e-3);
        }
    }
}
