//! Pictures drawn at a part of the resolution and enlarged, as the colour buffer of Umenhoffer, Szirmay-Kalos & Szijarto
//! (Spherical billboards for rendering volumetric data, ShaderX 5), but of the whole picture, opaque surfaces included.

use rayon::prelude::*;

use crate::picture::Film;
use crate::scene::Camera;

/// The camera of a picture with pixels `n` times as wide and high, about the same middle. Where `n` does not divide the
/// size, the picture reaches beyond the frame, so that pixels stay square.
pub fn smaller(camera: &Camera, n: u32) -> Camera {
    let size = camera.size.map(|length| length.div_ceil(n));
    let beyond = f64::from(n * size[1]) / f64::from(camera.size[1]);
    let fov_y = 2.0 * ((0.5 * camera.fov_y).tan() * beyond).atan();
    Camera { size, fov_y, ..camera.clone() }
}

/// Fills colour and transmittance of `out` from a film of [`smaller`]'s camera, bilinear between pixel centres.
pub fn enlarge(film: &Film, n: u32, out: &mut Film) {
    let [columns, rows] = [0, 1].map(|axis| places(film.size[axis], out.size[axis], n));
    let (width, small) = (out.size[0] as usize, film.size[0] as usize);
    let from = film.color.iter().chain([&film.transmittance]);
    for (plane, from) in out.color.iter_mut().chain([&mut out.transmittance]).zip(from) {
        plane.par_chunks_mut(width).zip(&rows).for_each(|(line, &(top, bottom, down))| {
            let (above, below) = (&from[top * small..][..small], &from[bottom * small..][..small]);
            // Written out: maps over arrays may become calls, five times as slow.
            for (value, &(left, right, across)) in line.iter_mut().zip(&columns) {
                let a = above[left] + across * (above[right] - above[left]);
                let b = below[left] + across * (below[right] - below[left]);
                *value = a + down * (b - a);
            }
        });
    }
}

/// For each of `large` pixels the two of `small` that it lies between, and how far it is towards the second.
fn places(small: u32, large: u32, n: u32) -> Vec<(usize, usize, f32)> {
    let last = f64::from(small - 1);
    // What the small picture holds more on either side.
    let margin = 0.5 * f64::from(n * small - large);
    let place = |pixel: u32| {
        let at = ((f64::from(pixel) + 0.5 + margin) / f64::from(n) - 0.5).clamp(0.0, last);
        (at as usize, (at as usize + 1).min(small as usize - 1), at.fract() as f32)
    };
    (0..large).map(place).collect()
}
