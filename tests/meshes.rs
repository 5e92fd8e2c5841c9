//! Opaque meshes: the glTF reader and the layer of colour and depth.

use glam::{DMat3, DVec2, DVec3};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use stereomist::input::mesh::{MESH_READERS, MeshEntry, load_mesh, load_mesh_noting};
use stereomist::render::cpu::simd::Level;
use stereomist::render::opaque::{OpaqueLayer, draw, draw_into};
use stereomist::scene::mesh::{Material, Texture, Wrap};
use stereomist::scene::{Camera, Mesh, Scene, Stereo, StereoMode, View};

// ------------------------------------------------------------------------------------------------------------- scenes

/// Two views from the origin along -z, eyes far enough apart to matter.
fn scene(size: [u32; 2], fov_y_deg: f64, meshes: Vec<Mesh>) -> Scene {
    Scene {
        camera: Camera {
            position: DVec3::ZERO,
            look_at: DVec3::NEG_Z,
            up: DVec3::Y,
            fov_y: fov_y_deg.to_radians(),
            size,
            near: 0.01,
            samples: 1,
        },
        stereo: Some(Stereo { interocular: 0.3, convergence: Some(4.0), mode: StereoMode::Parallel }),
        background: [0.0; 3],
        particles: Vec::new(),
        meshes,
    }
}

fn plain(positions: Vec<DVec3>, corners: Vec<[u32; 3]>) -> Mesh {
    Mesh {
        name: "test".to_owned(),
        triangle_materials: vec![0; corners.len()],
        materials: vec![Material { color: [1.0; 3], texture: None, unlit: false }],
        positions,
        corners,
        ..Mesh::default()
    }
}

/// A parallelogram of two triangles from a corner and two sides.
fn quad(corner: DVec3, u: DVec3, v: DVec3) -> Mesh {
    plain(vec![corner, corner + u, corner + u + v, corner + v], vec![[0, 1, 2], [0, 2, 3]])
}

fn for_each_pixel(view: &View, layer: &OpaqueLayer, mut f: impl FnMut(DVec3, f64, [f32; 3])) {
    let [width, height] = view.size;
    assert_eq!(layer.depth.len(), (width * height) as usize);
    assert_eq!(layer.color.len(), layer.depth.len());
    for y in 0..height {
        for x in 0..width {
            let i = (y * width + x) as usize;
            f(view.direction(f64::from(x) + 0.5, f64::from(y) + 0.5), layer.depth[i], layer.color[i]);
        }
    }
}

/// Numbers in [-1, 1) that are the same on every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        // Knuth's MMIX constants; the high bits are the good ones.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }

    fn rotation(&mut self) -> DMat3 {
        let axis = self.vector().normalize();
        DMat3::from_axis_angle(axis, 3.0 * self.next())
    }
}

/// The nearest hit beyond `near` by Moeller & Trumbore (1997), in eye space: depth, and how close to an edge (in
/// barycentric coordinates) the decision was anywhere on the way.
fn trace(triangles: &[[DVec3; 3]], direction: DVec3, near: f64) -> (f64, f64) {
    let (mut nearest, mut margin) = (f64::INFINITY, f64::INFINITY);
    for &[a, b, c] in triangles {
        let (e1, e2) = (b - a, c - a);
        let p = direction.cross(e2);
        let determinant = e1.dot(p);
        // Edge-on triangles have no stable answer.
        if determinant.abs() < 1e-9 * e1.length() * e2.length() * direction.length() {
            margin = 0.0;
            continue;
        }
        let u = -a.dot(p) / determinant;
        let q = (-a).cross(e1);
        let v = direction.dot(q) / determinant;
        let t = e2.dot(q) / determinant;
        let inside = u.min(v).min(1.0 - u - v);
        if t > near * 0.5 {
            margin = margin.min(inside.abs()).min((t - near).abs());
        }
        if inside >= 0.0 && t > near {
            nearest = nearest.min(t);
        }
    }
    (nearest, margin)
}

// ---------------------------------------------------------------------------------------------------------- visibility

#[test]
fn no_mesh_no_layer() {
    let empty = scene([4, 4], 40.0, vec![]);
    assert!(draw(&empty, &empty.views()[0]).is_none());
    let hollow = scene([4, 4], 40.0, vec![Mesh::default()]);
    assert!(draw(&hollow, &hollow.views()[0]).is_none());
}

#[test]
fn quad_has_its_depth_and_outline_from_both_eyes() {
    let (low, high) = (DVec2::new(-0.9, -0.52), DVec2::new(1.13, 0.77));
    let mesh = quad(DVec3::new(low.x, low.y, -4.0), DVec3::X * (high.x - low.x), DVec3::Y * (high.y - low.y));
    let scene = scene([97, 61], 40.0, vec![mesh]);
    for view in scene.views() {
        let layer = draw(&scene, &view).expect("a mesh");
        let mut covered = 0;
        for_each_pixel(&view, &layer, |direction, depth, color| {
            let hit = view.position + direction * 4.0;
            let inside = hit.x >= low.x && hit.x <= high.x && hit.y >= low.y && hit.y <= high.y;
            assert_eq!(depth.is_finite(), inside, "at {hit}");
            if inside {
                covered += 1;
                assert!((depth - 4.0).abs() < 1e-12);
                // The light stands between the eyes, and the quad faces it along z.
                let cosine = 4.0 / hit.length();
                assert!((f64::from(color[0]) - cosine).abs() < 1e-6);
            }
        });
        assert!(covered > 500);
    }
}

#[test]
fn slanted_plane_has_its_depth() {
    // The plane n . p = h, seen by rays t d: t = h / (n . d).
    let n = DVec3::new(0.3, 0.5, 0.8).normalize();
    let u = n.any_orthonormal_vector() * 40.0;
    let v = n.cross(u);
    let center = n * -3.0;
    let scene = scene([64, 48], 50.0, vec![quad(center - (u + v) * 0.5, u, v)]);
    for view in scene.views() {
        let layer = draw(&scene, &view).expect("a mesh");
        for_each_pixel(&view, &layer, |direction, depth, _| {
            let expected = n.dot(center - view.position) / n.dot(direction);
            if expected > 0.0 && expected < 12.0 {
                assert!((depth - expected).abs() < 1e-11 * expected, "{depth} for {expected}");
            }
        });
    }
}

#[test]
fn near_plane_cuts_a_floor() {
    let mut scene =
        scene([64, 48], 60.0, vec![quad(DVec3::new(-50.0, -1.0, 50.0), DVec3::X * 100.0, DVec3::Z * -100.0)]);
    scene.camera.near = 3.0;
    for view in scene.views() {
        let layer = draw(&scene, &view).expect("a mesh");
        let (mut cut, mut seen) = (0, 0);
        for_each_pixel(&view, &layer, |direction, depth, _| {
            let expected = -1.0 / direction.y;
            if expected > 3.0 && expected < 49.0 {
                seen += 1;
                assert!((depth - expected).abs() < 1e-11 * expected);
            } else if expected <= 3.0 {
                cut += usize::from(expected > 0.0);
                assert_eq!(depth, f64::INFINITY);
            }
        });
        assert!(cut > 100 && seen > 100);
    }
}

#[test]
fn box_around_the_camera_shows_all_six_walls() {
    let mut mesh = plain(vec![], vec![]);
    mesh.materials.clear();
    let half = DVec3::new(2.0, 1.5, 3.0);
    for axis in 0..3 {
        for (k, side) in [-1.0, 1.0].into_iter().enumerate() {
            let mut center = DVec3::ZERO;
            center[axis] = side * half[axis];
            let (mut u, mut v) = (DVec3::ZERO, DVec3::ZERO);
            u[(axis + 1) % 3] = half[(axis + 1) % 3];
            v[(axis + 2) % 3] = half[(axis + 2) % 3];
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([center - u - v, center + u - v, center + u + v, center - u + v]);
            mesh.corners.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            mesh.triangle_materials.extend([mesh.materials.len() as u32; 2]);
            let color = [(2 * axis + k) as f32, 1.0, 0.0];
            mesh.materials.push(Material { color, texture: None, unlit: true });
        }
    }
    let mut scene = scene([40, 40], 100.0, vec![mesh]);
    let mut walls = [0; 6];
    for look in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
        scene.camera.look_at = look;
        scene.camera.up = DVec3::new(look.y, look.z, look.x);
        for view in scene.views() {
            let layer = draw(&scene, &view).expect("a mesh");
            for_each_pixel(&view, &layer, |direction, depth, color| {
                let ray = view.eye_from_world.transpose() * direction;
                // The walls' distances along the ray; the nearest of those ahead is seen.
                let distances: Vec<f64> = (0..6)
                    .map(|i| {
                        let side = if i % 2 == 0 { -1.0 } else { 1.0 };
                        let t = (side * half[i / 2] - view.position[i / 2]) / ray[i / 2];
                        if t > 0.0 { t } else { f64::INFINITY }
                    })
                    .collect();
                let wall = (0..6).min_by(|&a, &b| distances[a].total_cmp(&distances[b])).expect("six");
                assert!((depth - distances[wall]).abs() < 1e-11 * depth, "{depth} for {}", distances[wall]);
                let second = (0..6).filter(|&i| i != wall).map(|i| distances[i]).fold(f64::INFINITY, f64::min);
                if second > distances[wall] * (1.0 + 1e-9) {
                    assert_eq!(color[0], wall as f32);
                    walls[wall] += 1;
                }
            });
        }
    }
    assert!(walls.iter().all(|&count| count > 300), "{walls:?}");
}

#[test]
fn random_triangles_match_a_ray_tracer() {
    let mut random = Random(7);
    let (mut compared, mut hits) = (0, 0);
    for round in 0..30 {
        // Triangles on all sides of the eye and through it, from tiny to huge.
        let size = [0.3, 2.0, 8.0, 1e4][round % 4];
        let positions: Vec<DVec3> = (0..12)
            .flat_map(|_| {
                let center = random.vector() * 5.0;
                [(); 3].map(|()| center + random.vector() * size)
            })
            .collect();
        let corners = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mut scene = scene([48, 36], 70.0, vec![plain(positions.clone(), corners)]);
        scene.camera.near = 0.2;
        for view in scene.views() {
            let layer = draw(&scene, &view).expect("a mesh");
            let eye: Vec<DVec3> = positions.iter().map(|&p| view.eye_from_point(p)).collect();
            let triangles: Vec<[DVec3; 3]> = eye.chunks(3).map(|c| [c[0], c[1], c[2]]).collect();
            for_each_pixel(&view, &layer, |direction, depth, _| {
                let (expected, margin) = trace(&triangles, direction, view.near);
                if margin > 1e-7 {
                    compared += 1;
                    if expected.is_finite() {
                        hits += 1;
                        assert!((depth - expected).abs() < 1e-8 * expected, "round {round}: {depth} for {expected}");
                    } else {
                        assert_eq!(depth, expected, "round {round}");
                    }
                }
            });
        }
    }
    assert!(compared > 90_000 && hits > 20_000, "{compared} {hits}");
}

#[test]
fn shared_edges_have_no_holes() {
    let mut random = Random(3);
    for round in 0..60 {
        // A ball of many facets around the eye, turned at random: every ray meets it.
        let rotation = random.rotation();
        let center = random.vector() * 0.4;
        let (rows, columns) = (12, 17);
        let mut positions = Vec::new();
        for row in 0..=rows {
            for column in 0..columns {
                let polar = std::f64::consts::PI * f64::from(row) / f64::from(rows);
                let around = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
                let point = DVec3::new(polar.sin() * around.cos(), polar.cos(), polar.sin() * around.sin());
                positions.push(center + rotation * point * (1.0 + f64::from(round)));
            }
        }
        let mut corners = Vec::new();
        for row in 0..rows {
            for column in 0..columns {
                let next = (column + 1) % columns;
                let at = |row: i32, column: i32| (row * columns + column) as u32;
                corners.push([at(row, column), at(row + 1, column), at(row + 1, next)]);
                corners.push([at(row, column), at(row + 1, next), at(row, next)]);
            }
        }
        let scene = scene([64, 64], 120.0, vec![plain(positions, corners)]);
        for view in scene.views() {
            let layer = draw(&scene, &view).expect("a mesh");
            assert!(layer.depth.iter().all(|depth| depth.is_finite()), "round {round}");
        }
    }
}

#[test]
fn diagonal_through_pixel_centres_has_no_hole() {
    // The diagonal of this quad passes exactly through the centres of a square picture's diagonal pixels.
    let corner = DVec3::new(-2.0, -2.0, -2.0);
    let mut scene = scene([32, 32], 90.0, vec![quad(corner, DVec3::X * 4.0, DVec3::Y * 4.0)]);
    scene.stereo = None;
    let view = &scene.views()[0];
    let layer = draw(&scene, view).expect("a mesh");
    assert!(layer.depth.iter().all(|&depth| (depth - 2.0).abs() < 1e-12));
}

#[test]
fn of_equal_depths_the_first_triangle_wins() {
    let wall = |color: [f32; 3]| {
        let mut mesh = quad(DVec3::new(-9.0, -9.0, -2.0), DVec3::X * 18.0, DVec3::Y * 18.0);
        mesh.materials[0] = Material { color, texture: None, unlit: true };
        mesh
    };
    let scene = scene([40, 40], 60.0, vec![Mesh::default(), wall([1.0, 0.0, 0.0]), wall([0.0, 1.0, 0.0])]);
    let layer = draw(&scene, &scene.views()[0]).expect("a mesh");
    assert!(layer.color.iter().all(|&color| color == [1.0, 0.0, 0.0]));
}

#[test]
fn degenerate_and_extreme_triangles_do_no_harm() {
    let far = 1e30;
    let points = vec![
        DVec3::new(0.0, 0.0, -1.0),
        DVec3::new(1.0, 1.0, -2.0),
        DVec3::new(2.0, 2.0, -3.0),
        DVec3::new(far, -1.0, far),
        DVec3::new(-far, -1.0, far),
        DVec3::new(0.0, -1.0, -far),
        DVec3::ZERO,
    ];
    let corners = vec![[0, 0, 0], [0, 1, 1], [0, 1, 2], [6, 0, 1], [3, 4, 5]];
    let mut scene = scene([64, 48], 60.0, vec![plain(points, corners)]);
    scene.stereo = None;
    let view = &scene.views()[0];
    let layer = draw(&scene, view).expect("a mesh");
    for_each_pixel(view, &layer, |direction, depth, _| {
        // Only the huge floor has extent; above the horizon there is nothing but the specks.
        if direction.y < 0.0 && (direction.x - direction.y).abs() > 1e-9 {
            assert!((depth + 1.0 / direction.y).abs() < 1e-6 * depth, "{depth} at {direction}");
        }
    });
}

#[test]
fn threads_do_not_change_the_layer() {
    let entry = MeshEntry::new(repository().join("scenes/data/watertower.gltf"));
    let mut scene = scene([160, 120], 40.0, vec![load_mesh(&entry).expect("the tower")]);
    scene.camera.position = DVec3::new(0.0, 1.5, 9.0);
    scene.camera.look_at = DVec3::new(0.0, 2.0, 0.0);
    let drawn = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| draw(&scene, &scene.views()[0])).expect("a mesh")
    };
    let (one, three) = (drawn(1), drawn(3));
    assert_eq!(one.depth, three.depth);
    assert_eq!(one.color, three.color);
}

/// Soups of triangles of all sizes and the textured tower, in pictures narrower than a vector and wider: the same to the bit at every
/// level, into memory that holds another picture.
#[test]
fn levels_and_old_memory_do_not_change_the_layer() {
    let entry = MeshEntry::new(repository().join("scenes/data/watertower.gltf"));
    let tower = load_mesh(&entry).expect("the tower");
    let mut random = Random(11);
    for size in [[3, 40], [8, 8], [131, 97], [160, 120]] {
        let (mut spare, mut hits) = (OpaqueLayer::default(), 0);
        for round in 0..6 {
            let mut scene = scene(size, 50.0, vec![tower.clone()]);
            if round % 2 == 0 {
                let reach = [0.1, 0.5, 3.0][round / 2];
                let corner = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
                let centers: Vec<DVec3> = (0..300).map(|_| 3.0 * random.vector()).collect();
                let positions = centers.iter().flat_map(|&center| [(); 3].map(|()| center + reach * random.vector()));
                scene.meshes = vec![plain(positions.collect(), (0..300).map(corner).collect())];
            } else {
                scene.camera.position = DVec3::new(0.0, 1.5, 9.0 - round as f64);
                scene.camera.look_at = DVec3::new(0.0, 2.0, 0.0);
            }
            let view = &scene.views()[0];
            let want = draw(&scene, view).expect("a mesh");
            hits += want.depth.iter().filter(|depth| depth.is_finite()).count();
            for level in Level::available() {
                let layer = draw_into(&scene, view, level, spare).expect("a mesh");
                assert_eq!(layer.depth, want.depth, "{level}, {size:?}, {round}");
                assert_eq!(layer.range, want.range, "{level}, {size:?}, {round}");
                let shown = |layer: &OpaqueLayer| -> Vec<[f32; 3]> {
                    let pixels = layer.color.iter().zip(&layer.depth);
                    pixels.filter(|(_, depth)| depth.is_finite()).map(|(&color, _)| color).collect()
                };
                assert_eq!(shown(&layer), shown(&want), "{level}, {size:?}, {round}");
                spare = layer;
            }
        }
        assert!(hits > (size[0] * size[1]) as usize, "{size:?}: {hits}");
    }
}

// -------------------------------------------------------------------------------------------------------------- colour

#[test]
fn textures_are_perspective_correct() {
    // Texels on a ramp, so that the bilinear look-up gives the coordinate itself.
    let count = 8;
    let texel = |i: u32| (i as f32 + 0.5) / count as f32;
    let texels = (0..count * count).map(|i| [texel(i % count), texel(i / count), 0.5]).collect();
    let mut mesh = quad(DVec3::new(-3.0, -1.0, -1.5), DVec3::X * 6.0, DVec3::new(0.0, 1.0, -9.0));
    mesh.texture_coordinates = vec![DVec2::new(0.0, 1.0), DVec2::ONE, DVec2::new(1.0, 0.0), DVec2::ZERO];
    mesh.textures = vec![Texture { width: count, height: count, texels, wrap: [Wrap::Clamp; 2] }];
    mesh.materials[0] = Material { color: [0.5, 1.0, 1.0], texture: Some(0), unlit: true };
    let scene = scene([80, 60], 60.0, vec![mesh]);
    let inner = 0.5 / f64::from(count)..1.0 - 0.5 / f64::from(count);
    for view in scene.views() {
        let layer = draw(&scene, &view).expect("a mesh");
        let mut seen = 0;
        for_each_pixel(&view, &layer, |direction, depth, color| {
            if !depth.is_finite() {
                return;
            }
            let hit = view.position + direction * depth;
            let (u, v) = ((hit.x + 3.0) / 6.0, 1.0 - (-1.5 - hit.z) / 9.0);
            if inner.contains(&u) && inner.contains(&v) {
                seen += 1;
                assert!((f64::from(color[0]) - 0.5 * u).abs() < 1e-6, "u {u}: {}", color[0]);
                assert!((f64::from(color[1]) - v).abs() < 1e-6, "v {v}: {}", color[1]);
                assert_eq!(color[2], 0.5);
            }
        });
        assert!(seen > 500);
    }
}

#[test]
fn wrapping_follows_the_texel_grid() {
    for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
        let values = [0.1_f32, 0.9, 0.4];
        let texels = values.iter().map(|&v| [v; 3]).collect();
        let mut mesh = quad(DVec3::new(-2.0, -2.0, -2.0), DVec3::X * 4.0, DVec3::Y * 4.0);
        let across = |u: f64| DVec2::new(u, 0.5);
        mesh.texture_coordinates = vec![across(-3.2), across(4.1), across(4.1), across(-3.2)];
        mesh.textures = vec![Texture { width: 3, height: 1, texels, wrap: [wrap; 2] }];
        mesh.materials[0] = Material { color: [1.0; 3], texture: Some(0), unlit: true };
        let mut scene = scene([301, 8], 90.0, vec![mesh]);
        scene.stereo = None;
        scene.camera.fov_y = 2.0 * (8.0_f64 / 301.0).atan();
        let view = &scene.views()[0];
        let texel = |i: i64| {
            let i = match wrap {
                Wrap::Repeat => i.rem_euclid(3),
                Wrap::Mirror => [0, 1, 2, 2, 1, 0][i.rem_euclid(6) as usize],
                Wrap::Clamp => i.clamp(0, 2),
            };
            f64::from(values[i as usize])
        };
        let layer = draw(&scene, view).expect("a mesh");
        for_each_pixel(view, &layer, |direction, _, color| {
            let u = -3.2 + 7.3 * (direction.x * 2.0 + 2.0) / 4.0;
            let position = u * 3.0 - 0.5;
            let low = position.floor();
            let weight = position - low;
            let expected = texel(low as i64) * (1.0 - weight) + texel(low as i64 + 1) * weight;
            assert!((f64::from(color[0]) - expected).abs() < 1e-6, "{wrap:?} {u}: {} for {expected}", color[0]);
        });
    }
}

#[test]
fn normals_and_vertex_colours_are_interpolated() {
    let mut mesh = quad(DVec3::new(-1.0, -1.0, -2.0), DVec3::X * 2.0, DVec3::Y * 2.0);
    mesh.colors = vec![[0.0, 0.5, 1.0], [1.0, 0.5, 1.0], [1.0, 0.5, 1.0], [0.0, 0.5, 1.0]];
    let tilted = DVec3::new(0.6, 0.0, 0.8);
    mesh.normals = vec![tilted; 4];
    let scene = scene([50, 50], 40.0, vec![mesh]);
    for view in scene.views() {
        let layer = draw(&scene, &view).expect("a mesh");
        for_each_pixel(&view, &layer, |direction, depth, color| {
            if depth.is_finite() {
                let hit = view.position + direction * depth;
                let cosine = (tilted.dot(hit) / hit.length()).abs();
                assert!((f64::from(color[0]) - cosine * (hit.x + 1.0) / 2.0).abs() < 1e-6);
                assert!((f64::from(color[1]) - cosine * 0.5).abs() < 1e-6);
            }
        });
    }
}

// --------------------------------------------------------------------------------------------------------------- glTF

fn repository() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn data_uri(bytes: &[u8]) -> String {
    let letters = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = "data:application/octet-stream;base64,".to_owned();
    for chunk in bytes.chunks(3) {
        let bits = chunk.iter().fold(0_u32, |bits, &b| bits << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        for k in 0..4 {
            let letter = letters[(bits >> (18 - 6 * k) & 63) as usize];
            text.push(if k <= chunk.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

fn glb(document: &Value, blob: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut blob = blob.to_vec();
    blob.resize(blob.len().next_multiple_of(4), 0);
    let word = |n: usize| (n as u32).to_le_bytes();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend(word(12 + 8 + text.len() + 8 + blob.len()));
    bytes.extend(word(text.len()));
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend(word(blob.len()));
    bytes.extend(b"BIN\0");
    bytes.extend(blob);
    bytes
}

fn png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::write_buffer_with_format(
        &mut bytes,
        rgb,
        width,
        height,
        image::ExtendedColorType::Rgb8,
        image::ImageFormat::Png,
    )
    .expect("a picture");
    bytes.into_inner()
}

/// Writes a file into a folder of its own and reads it as a mesh.
fn load_bytes(name: &str, bytes: &[u8]) -> stereomist::Result<Mesh> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file");
    load_mesh(&MeshEntry::new(path))
}

fn load_json(document: &Value) -> stereomist::Result<Mesh> {
    load_bytes("test.gltf", document.to_string().as_bytes())
}

fn refusal(result: stereomist::Result<Mesh>) -> String {
    let message = result.expect_err("a refusal").to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    message
}

/// A triangle (0,0,0) (1,0,0) (0,1,0) in a data URI, for tests to change.
fn triangle() -> Value {
    let bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": bytes.len(), "uri": data_uri(&bytes)}],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    })
}

/// Sets the value at a JSON pointer; with a new last key, adds it.
fn with(mut document: Value, pointer: &str, value: Value) -> Value {
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
    let parent = document.pointer_mut(parent).expect("a parent");
    match parent {
        Value::Array(items) => items[key.parse::<usize>().expect("an index")] = value,
        _ => parent[key] = value,
    }
    document
}

/// A document that uses every feature that the reader knows, with its bytes in one buffer without a URI.
fn rich() -> (Value, Vec<u8>) {
    let mut blob = Vec::new();
    let mut views = Vec::new();
    let mut add = |bytes: &[u8], stride: Option<usize>| {
        blob.resize(blob.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": blob.len(), "byteLength": bytes.len()});
        if let Some(stride) = stride {
            view["byteStride"] = json!(stride);
        }
        blob.extend(bytes);
        views.push(view);
        views.len() - 1
    };
    // Positions and normals interleaved, four vertices.
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let interleaved: Vec<f32> = corners.iter().flat_map(|c| [c[0], c[1], 0.0, 0.0, 0.0, 2.0]).collect();
    let points = add(&floats(&interleaved), Some(24));
    let uvs = add(&[0, 255, 0, 0, 255, 255, 0, 0, 0, 0, 0, 0, 255, 0, 0, 0], Some(4));
    let colors: Vec<u8> = [[65535_u16, 0, 0, 65535]; 4].iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let colors = add(&colors, None);
    let strip = add(&[0, 1, 2, 3], None);
    let list: Vec<u8> = [0_u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()).collect();
    let list = add(&list, None);
    let sparse_indices = add(&3_u16.to_le_bytes(), None);
    let sparse_values = add(&floats(&[1.0, 1.0, 0.5]), None);
    let picture = add(&png(2, 1, &[255, 255, 255, 188, 0, 0]), None);
    let document = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_texture_transform", "KHR_materials_unlit"],
        "extensionsRequired": ["KHR_texture_transform"],
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"children": [1, 2], "translation": [0, 0, -5]},
            {"mesh": 0, "rotation": [0, 0, 3, 3], "scale": [2, 1, 1]},
            {"mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 3,0,0,1]},
        ],
        "meshes": [{"primitives": [
            {
                "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_1": 2, "COLOR_0": 3},
                "indices": 4, "material": 0, "mode": 5,
            },
            {"attributes": {"POSITION": 6}, "indices": 5, "material": 1},
            {"attributes": {"POSITION": 0}, "mode": 6},
            {"attributes": {"POSITION": 0}, "mode": 1},
        ]}],
        "materials": [
            {"pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 1, 1, 1],
                "baseColorTexture": {"index": 0, "texCoord": 1, "extensions": {
                    "KHR_texture_transform": {"offset": [0.25, 0], "scale": [2, 1]}}}}},
            {"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"baseColorFactor": [0, 1, 0, 1]}},
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33648, "wrapT": 33071}],
        "images": [{"bufferView": picture, "mimeType": "image/png"}],
        "buffers": [{"byteLength": 0}],
        "bufferViews": [],
        "accessors": [
            {"bufferView": points, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": points, "byteOffset": 12, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": uvs, "componentType": 5121, "normalized": true, "count": 4, "type": "VEC2"},
            {"bufferView": colors, "componentType": 5123, "normalized": true, "count": 4, "type": "VEC4"},
            {"bufferView": strip, "componentType": 5121, "count": 4, "type": "SCALAR"},
            {"bufferView": list, "componentType": 5125, "count": 3, "type": "SCALAR"},
            {"bufferView": points, "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
                "count": 1,
                "indices": {"bufferView": sparse_indices, "componentType": 5123},
                "values": {"bufferView": sparse_values}}},
        ],
    });
    let document = with(document, "/bufferViews", Value::Array(views));
    (with(document, "/buffers/0/byteLength", json!(blob.len())), blob)
}

#[test]
fn rich_glb_is_read() {
    let (document, blob) = rich();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rich.glb");
    std::fs::write(&path, glb(&document, &blob)).unwrap();
    let mut notes = Vec::new();
    let mesh = load_mesh_noting(&MeshEntry::new(&path), &mut notes).expect("a valid file");
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert!(notes[0].contains("lines"), "{notes:?}");
    // Two instances of a strip of two triangles, a single one and a fan of two.
    assert_eq!(mesh.corners.len(), 2 * 5);
    assert_eq!(mesh.positions.len(), 2 * 12);
    assert_eq!(mesh.normals.len(), 24);
    assert_eq!(mesh.corners[..2], [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(mesh.corners[3..5], [[8, 9, 10], [8, 10, 11]]);
    // The first instance: scaled by 2 along x, turned x to y, moved back by 5.
    assert!((mesh.positions[1] - DVec3::new(0.0, 2.0, -5.0)).length() < 1e-6, "{}", mesh.positions[1]);
    assert!((mesh.positions[12 + 3] - DVec3::new(4.0, 1.0, -5.0)).length() < 1e-6);
    assert!((mesh.normals[0] - DVec3::Z).length() < 1e-9);
    assert_eq!(mesh.normals[5], DVec3::ZERO);
    // The sparse accessor moves its last vertex.
    assert!((mesh.positions[12 + 7] - DVec3::new(4.0, 1.0, -4.5)).length() < 1e-6);
    assert_eq!(mesh.texture_coordinates[1], DVec2::new(2.25, 1.0));
    assert_eq!(mesh.colors[0], [1.0, 0.0, 0.0]);
    assert_eq!(mesh.colors[4], [1.0; 3]);
    let materials: Vec<&Material> = mesh.triangle_materials.iter().map(|&m| &mesh.materials[m as usize]).collect();
    assert_eq!((materials[0].color, materials[0].texture, materials[0].unlit), ([0.5, 1.0, 1.0], Some(0), false));
    assert_eq!((materials[2].color, materials[2].texture, materials[2].unlit), ([0.0, 1.0, 0.0], None, true));
    // What has no material is as grey as the entry says.
    assert_eq!(materials[3].color, [0.6; 3]);
    let texture = &mesh.textures[0];
    assert_eq!((texture.width, texture.height, texture.wrap), (2, 1, [Wrap::Mirror, Wrap::Clamp]));
    assert_eq!(texture.texels[0], [1.0; 3]);
    // 188 is the sRGB value of half the light, to within its step.
    assert!((texture.texels[1][0] - 0.5).abs() < 4e-3);
}

#[test]
fn data_uri_and_entry_transform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, triangle().to_string()).unwrap();
    let entry = MeshEntry {
        position: DVec3::new(10.0, 0.0, 0.0),
        rotation_deg: DVec3::new(90.0, 0.0, 90.0),
        scale: 2.0,
        color: [0.1, 0.2, 0.3],
        ..MeshEntry::new(&path)
    };
    let mesh = load_mesh(&entry).expect("a valid file");
    // x is turned to y by the rotation about z; y first to z, where the rotation about z leaves it.
    for (point, expected) in mesh.positions.iter().zip([[10.0, 0.0, 0.0], [10.0, 2.0, 0.0], [10.0, 0.0, 2.0]]) {
        assert!((*point - DVec3::from(expected)).length() < 1e-12, "{point}");
    }
    assert_eq!(mesh.materials[0].color, [0.1, 0.2, 0.3]);
    assert!(mesh.normals.is_empty() && mesh.texture_coordinates.is_empty() && mesh.colors.is_empty());
}

#[test]
fn normals_follow_the_inverse_transpose() {
    let bytes = floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 0.0]);
    let document = with(triangle(), "/buffers/0", json!({"byteLength": 72, "uri": data_uri(&bytes)}));
    let document = with(document, "/bufferViews/0/byteLength", json!(72));
    let document = with(document, "/meshes/0/primitives/0/attributes/NORMAL", json!(1));
    let second = json!({"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC3"});
    let first = document["accessors"][0].clone();
    let document = with(document, "/accessors", json!([first, second]));
    let document = with(document, "/nodes/0/scale", json!([2, 1, 1]));
    let mesh = load_json(&document).expect("a valid file");
    let expected = DVec3::new(0.3, 0.8, 0.0).normalize();
    assert!((mesh.normals[0] - expected).length() < 1e-6, "{}", mesh.normals[0]);
    assert_eq!(mesh.normals[2], DVec3::ZERO);
}

#[test]
fn scenes_default_to_the_first_and_to_all_root_nodes() {
    let mut document = triangle();
    document["nodes"] = json!([{"mesh": 0, "translation": [1, 0, 0]}, {"children": [0]}, {"mesh": 0}]);
    document["scenes"] = json!([{"nodes": [2]}, {"nodes": [1, 2]}]);
    document["scene"] = json!(1);
    assert_eq!(load_json(&document).expect("valid").corners.len(), 2);
    document.as_object_mut().unwrap().remove("scene");
    assert_eq!(load_json(&document).expect("valid").corners.len(), 1);
    document.as_object_mut().unwrap().remove("scenes");
    let mesh = load_json(&document).expect("valid");
    assert_eq!(mesh.corners.len(), 2);
    assert_eq!(mesh.positions[0], DVec3::X);
}

#[test]
fn files_beside_the_document_are_found_and_missed() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let path = folder.path().join("a.GLTF");
    let document = with(triangle(), "/buffers/0/uri", json!("two%20words.bin"));
    std::fs::write(&path, document.to_string()).unwrap();
    let message = refusal(load_mesh(&MeshEntry::new(&path)));
    assert!(message.contains("two words.bin") && message.contains("a.GLTF"), "{message}");
    std::fs::write(folder.path().join("two words.bin"), &bytes[..20]).unwrap();
    let message = refusal(load_mesh(&MeshEntry::new(&path)));
    assert!(message.contains("20") && message.contains("36"), "{message}");
    std::fs::write(folder.path().join("two words.bin"), &bytes).unwrap();
    assert_eq!(load_mesh(&MeshEntry::new(&path)).expect("valid").corners.len(), 1);

    let message = refusal(load_json(&with(triangle(), "/buffers/0/uri", json!("https://example.org/a.bin"))));
    assert!(message.contains("only files"), "{message}");
    let message = refusal(load_mesh(&MeshEntry::new(folder.path().join("none.glb"))));
    assert!(message.contains("none.glb"), "{message}");
    let message = refusal(load_mesh(&MeshEntry::new(folder.path())));
    assert!(message.contains(".gltf"), "{message}");
    let message = refusal(load_mesh(&MeshEntry::new("a.fbx")));
    assert!(MESH_READERS.iter().flat_map(|r| r.extensions).all(|e| message.contains(e)), "{message}");
}

#[test]
fn malformed_documents_are_refused_by_name() {
    let huge = json!(u64::MAX);
    let (rich, blob) = rich();
    let cases: Vec<(Value, &str)> = vec![
        (with(triangle(), "/accessors/0/count", json!(4)), "accessor 0"),
        (with(triangle(), "/accessors/0/count", huge.clone()), "too large"),
        (with(triangle(), "/accessors/0/byteOffset", huge.clone()), "accessor 0"),
        (with(triangle(), "/accessors/0/bufferView", json!(7)), "buffer view 7"),
        (with(triangle(), "/accessors/0/componentType", json!(5121)), "accessor 0"),
        (with(triangle(), "/accessors/0/componentType", json!(1)), "accessor 0"),
        (with(triangle(), "/accessors/0/type", json!("VEC5")), "accessor 0"),
        (with(triangle(), "/bufferViews/0/byteLength", json!(37)), "buffer view 0"),
        (with(triangle(), "/bufferViews/0/byteOffset", huge.clone()), "buffer view 0"),
        (with(triangle(), "/bufferViews/0/byteStride", json!(4)), "stride"),
        (with(triangle(), "/bufferViews/0/byteStride", huge.clone()), "accessor 0"),
        (with(triangle(), "/bufferViews/0/buffer", json!(1)), "buffer 1"),
        (with(triangle(), "/buffers/0/byteLength", json!(37)), "buffer 0"),
        (with(triangle(), "/buffers/0/byteLength", huge), "too large"),
        (with(triangle(), "/buffers/0/uri", json!("data:;base64,A")), "base64"),
        (with(triangle(), "/buffers/0/uri", json!("data:")), "comma"),
        (with(triangle(), "/buffers/0", json!({"byteLength": 36})), "neither"),
        (with(triangle(), "/nodes/0/mesh", json!(1)), "mesh 1"),
        (with(triangle(), "/nodes/0/children", json!([0])), "node 0"),
        (with(triangle(), "/nodes/0/children", json!([5])), "node 5"),
        (with(triangle(), "/nodes/0/scale", json!([1e38, 1e38, 1e38])), ""),
        (with(triangle(), "/scene", json!(3)), "scene 3"),
        (with(triangle(), "/meshes/0/primitives/0/mode", json!(0)), "no triangles"),
        (with(triangle(), "/meshes/0/primitives/0/mode", json!(9)), "mode"),
        (with(triangle(), "/meshes/0/primitives/0/material", json!(0)), "material 0"),
        (with(triangle(), "/meshes/0/primitives/0/indices", json!(0)), "accessor 0"),
        (with(triangle(), "/asset/version", json!("1.0")), "1.0"),
        (with(triangle(), "/extensionsRequired", json!(["KHR_draco_mesh_compression"])), "KHR_draco_mesh_compression"),
        (with(triangle(), "/extensionsRequired", json!(["KHR_mesh_quantization"])), "KHR_mesh_quantization"),
        (with(triangle(), "/extensionsRequired", json!(["EXT_meshopt_compression"])), "EXT_meshopt_compression"),
        // Used, not required, and yet without plain data.
        (
            with(
                with(triangle(), "/accessors/0", json!({"componentType": 5126, "count": 3, "type": "VEC3"})),
                "/extensionsUsed",
                json!(["KHR_draco_mesh_compression"]),
            ),
            "KHR_draco_mesh_compression",
        ),
        (
            with(
                with(triangle(), "/buffers/0", json!({"byteLength": 36})),
                "/extensionsUsed",
                json!(["EXT_meshopt_compression"]),
            ),
            "EXT_meshopt_compression",
        ),
        (
            with(
                with(triangle(), "/accessors/0/componentType", json!(5122)),
                "/extensionsUsed",
                json!(["KHR_mesh_quantization"]),
            ),
            "KHR_mesh_quantization",
        ),
        (with(rich.clone(), "/accessors/5/count", json!(4)), "accessor 5"),
        (with(rich.clone(), "/accessors/4/componentType", json!(5123)), "accessor 4"),
        (with(rich.clone(), "/accessors/6/sparse/count", json!(9)), "accessor 6"),
        (with(rich.clone(), "/accessors/6/sparse/indices/byteOffset", json!(1)), "accessor 6"),
        (with(rich.clone(), "/accessors/1/count", json!(3)), "accessor 1"),
        (with(rich.clone(), "/images/0/bufferView", json!(0)), "image 0"),
        (with(rich.clone(), "/textures/0/source", json!(4)), "image 4"),
        (with(rich.clone(), "/textures/0/sampler", json!(4)), "sampler 4"),
        (with(rich.clone(), "/samplers/0/wrapS", json!(4)), "wrapping"),
    ];
    for (document, word) in cases {
        let result = if document["buffers"][0].get("uri").is_some() || document["scene"] == 0 {
            load_json(&document)
        } else {
            load_bytes("test.glb", &glb(&document, &blob))
        };
        // A scale of 1e38 is odd but can be shown.
        if word.is_empty() {
            result.expect("can be shown");
            continue;
        }
        let message = refusal(result);
        assert!(message.contains(word), "`{word}` should be named: {message}");
    }
}

#[test]
fn nothing_grows_beyond_its_file() {
    // Forty thousand nodes that show a mesh of a thousand vertices: within the structure, beyond the memory.
    let mut document = triangle();
    let bytes = vec![0; 12_000];
    document["buffers"] = json!([{"byteLength": bytes.len(), "uri": data_uri(&bytes)}]);
    document["bufferViews"] = json!([{"buffer": 0, "byteLength": bytes.len()}]);
    document["accessors"][0]["count"] = json!(999);
    document["nodes"] = Value::Array(vec![json!({"mesh": 0}); 40_000]);
    document["scenes"][0]["nodes"] = Value::Array((0..40_000).map(|i| json!(i)).collect());
    assert!(refusal(load_json(&document)).contains("too large"));
    // A chain as deep as it likes is no trouble.
    let mut nodes: Vec<Value> = (1..40_000).map(|i| json!({"children": [i]})).collect();
    nodes.push(json!({"mesh": 0}));
    document["nodes"] = Value::Array(nodes);
    document["scenes"][0]["nodes"] = json!([0]);
    assert_eq!(load_json(&document).expect("valid").corners.len(), 333);
    // Small objects by the million.
    let text = format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"nodes\": [{}{{}}]}}", "{},".repeat(1 << 20));
    assert!(refusal(load_bytes("a.gltf", text.as_bytes())).contains("objects"));
    // A picture that says it is larger than anything.
    let (rich, mut blob) = rich();
    let start = rich["bufferViews"][7]["byteOffset"].as_u64().unwrap() as usize;
    assert_eq!(&blob[start + 12..start + 16], b"IHDR");
    blob[start + 16..start + 24].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff]);
    assert!(refusal(load_bytes("a.glb", &glb(&rich, &blob))).contains("image 0"));
}

#[test]
fn every_truncation_of_a_glb_is_refused() {
    let (document, blob) = rich();
    let bytes = glb(&document, &blob);
    for length in (0..bytes.len()).step_by(7) {
        refusal(load_bytes("a.glb", &bytes[..length]));
    }
}

/// Whatever comes of it: no panic, and a mesh that keeps its promises.
fn survive(name: &str, bytes: &[u8]) {
    match load_bytes(name, bytes) {
        Err(error) => assert!(!error.to_string().is_empty()),
        Ok(mesh) => {
            let count = mesh.positions.len();
            assert!(mesh.corners.iter().flatten().all(|&corner| (corner as usize) < count));
            assert!(mesh.triangle_materials.len() == mesh.corners.len());
            assert!(mesh.triangle_materials.iter().all(|&m| (m as usize) < mesh.materials.len()));
            for length in [mesh.normals.len(), mesh.texture_coordinates.len(), mesh.colors.len()] {
                assert!(length == 0 || length == count);
            }
            let scene = scene([8, 6], 60.0, vec![mesh]);
            draw(&scene, &scene.views()[0]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_do_no_harm(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        survive("a.glb", &bytes);
        let mut glb = b"glTF\x02\0\0\0".to_vec();
        glb.extend((12 + bytes.len() as u32).to_le_bytes());
        glb.extend(&bytes);
        survive("a.glb", &glb);
    }

    #[test]
    fn flipped_bits_do_no_harm(flips in proptest::collection::vec((any::<prop::sample::Index>(), 0..8_u32), 1..6)) {
        let (document, blob) = rich();
        let mut bytes = glb(&document, &blob);
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
        }
        survive("a.glb", &bytes);
    }

    #[test]
    fn changed_numbers_do_no_harm(changes in proptest::collection::vec((any::<prop::sample::Index>(), 0..12_usize), 1..4)) {
        let (document, blob) = rich();
        let mut text = document.to_string();
        for (at, number) in changes {
            let starts: Vec<usize> = text
                .char_indices()
                .zip(text.chars().skip(1))
                .filter(|((_, before), after)| ":[,".contains(*before) && after.is_ascii_digit())
                .map(|((at, _), _)| at + 1)
                .collect();
            let start = starts[at.index(starts.len())];
            let end = start + text[start..].find(|c: char| !c.is_ascii_digit() && c != '.').expect("an end");
            let number = ["0", "1", "2", "5", "13", "255", "65535", "4294967295", "18446744073709551615", "-1", "1e300",
                "5126"][number];
            text.replace_range(start..end, number);
        }
        if let Ok(document) = serde_json::from_str(&text) {
            survive("a.glb", &glb(&document, &blob));
        }
    }

    #[test]
    fn truncated_documents_do_no_harm(length in any::<prop::sample::Index>()) {
        let text = std::fs::read(repository().join("tests/data/watertower/watertower.gltf")).unwrap();
        refusal(load_bytes("a.gltf", &text[..length.index(text.len() - 2)]));
    }
}

// -------------------------------------------------------------------------------------------------------------- towers

fn extent(mesh: &Mesh) -> [DVec3; 2] {
    let low = mesh.positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    [low, mesh.positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max)]
}

#[test]
fn towers_are_read() {
    let kaykit = load_mesh(&MeshEntry::new(repository().join("tests/data/watertower/watertower.gltf"))).expect("valid");
    assert_eq!(kaykit.corners.len(), 146);
    assert_eq!(kaykit.textures.len(), 1);
    let [low, high] = extent(&kaykit);
    assert!(low.y.abs() < 1e-5 && (high.y - 0.67).abs() < 1e-6);

    let path: &Path = &repository().join("scenes/data/watertower.gltf");
    let mut notes = Vec::new();
    let ours = load_mesh_noting(&MeshEntry::new(path), &mut notes).expect("valid");
    assert!(notes.is_empty(), "{notes:?}");
    let [low, high] = extent(&ours);
    assert!(low.y > -0.05 && (high.y - 5.2).abs() < 1e-6, "{low} {high}");
    assert_eq!([low.x, low.z, high.x, high.z], [-12.0, -12.0, 12.0, 12.0]);
    // Every triangle faces where its normals point.
    for corners in &ours.corners {
        let [a, b, c] = corners.map(|corner| ours.positions[corner as usize]);
        let facing = (b - a).cross(c - a);
        assert!(facing.length() > 0.0);
        assert!(corners.iter().all(|&corner| ours.normals[corner as usize].dot(facing) > 0.0), "{a} {b} {c}");
    }
}
