//! Blocks of rays: which particles they meet, slab by slab, and what of it the film gets.

use super::composite::{Slot, Sums, composite, last_seen};
use super::fragment::{Fragment, GROUP, THICK};
use super::light::{FEW, Light};
use super::local::{FINENESS, Local};
use super::{Ball, Cut, Gas, Mask, ROWS};
use crate::picture::Film;
use crate::render::cpu::nearby::{Beam, Hit, Nearby};
use crate::render::cpu::primitive::{Leg, Shape};
use crate::render::cpu::simd::{Simd, WithSimd};
use crate::render::cpu::splat::Bounds;
use crate::render::cpu::tile::{self, TILE, stop_transmittance, survey};
use crate::render::opaque::OpaqueLayer;
use crate::scene::{Rgb, View};
use std::f32::consts::LOG2_E;

/// What is the same for all bands of a view.
pub struct Picture<'a> {
    pub gas: &'a Gas<'a>,
    pub view: &'a View,
    pub opaque: Option<&'a OpaqueLayer>,
    /// In order of the first slab.
    pub balls: &'a [Ball],
    pub bounds: &'a [Bounds],
    /// Depth of the plane behind each slab; none where each block has its own.
    pub planes: &'a [f32],
    pub mask: Option<&'a Mask>,
    pub background: Rgb,
    /// As in [`super::Canvas`].
    pub error: f32,
}

/// A band of tiles: rows of the film.
pub struct Band<'a> {
    y: usize,
    /// Red, green, blue, transmittance.
    planes: [&'a mut [f32]; 4],
    error: Option<&'a mut [f32]>,
}

pub fn bands(film: &mut Film, rows: usize) -> Vec<Band<'_>> {
    let mut error = film.error.as_mut().map(|plane| plane.chunks_mut(film.size[0] as usize * rows));
    tile::bands(film.size[0], rows, &mut film.color, &mut film.transmittance)
        .enumerate()
        .map(|(number, planes)| Band { y: number * rows, planes, error: error.as_mut().and_then(Iterator::next) })
        .collect()
}

pub struct BandJob<'a, 'b> {
    pub picture: &'a Picture<'a>,
    /// The particles that touch the band.
    pub list: &'a [u32],
    pub band: Band<'b>,
}

/// The rays of a block of [`Simd::LANES`] x `R` pixels.
pub struct Rays<F, const R: usize> {
    /// Tangents.
    pub x: F,
    pub y: [f32; R],
    /// |dir| with dir.z = -1, its inverse and the square of that.
    pub length: [F; R],
    pub inverse: [F; R],
    pub weight: [F; R],
    /// Opaque depth in two parts.
    pub wall: [[F; 2]; R],
    /// 0, 1, 2, ...
    pub ramp: F,
}

/// Memory of a band's work.
struct Scratch<S: Simd, const R: usize> {
    slots: Vec<Slot<S::F, R>>,
    legs: Vec<Leg<S::F, GROUP>>,
    nearby: Nearby,
    local: Local,
    /// Thickness of the next block's own slabs, in radii.
    fineness: f32,
    /// The largest error that own slabs leave, by their estimate.
    error: f32,
}

/// What own slabs may be off, from which a Gaussian's shares of them may be less exact.
const COARSE: f32 = 1e-3;

/// Planes in a ball, at the most, for that.
const COARSEST: usize = 8;

/// A tile's particles and colours.
pub struct Tile {
    at: [usize; 2],
    size: [usize; 2],
    /// The colours, if they are few.
    pub palette: Option<([Rgb; FEW], usize)>,
    /// Nearest opaque depth; infinite if there is none.
    nearest: f32,
    /// Transmittance below which nothing behind can change a channel by more than the tolerance.
    pub stop: f32,
}

impl WithSimd for BandJob<'_, '_> {
    /// The fragments, and the largest error that the blocks' own slabs leave.
    type Output = (u64, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> Self::Output {
        self.run::<S, ROWS>(s)
    }
}

impl BandJob<'_, '_> {
    /// Draws the band in blocks of `R` rows.
    #[inline(always)]
    fn run<S: Simd, const R: usize>(self, s: S) -> (u64, f32) {
        let Self { picture, list, mut band } = self;
        let width = picture.view.size[0] as usize;
        let rows = band.planes[0].len() / width;
        let band_y = band.y;
        let mut scratch = Scratch::<S, R> {
            slots: vec![[[s.splat(0.0); 4]; R]; picture.planes.len()],
            legs: Vec::new(),
            nearby: Nearby::default(),
            local: Local::default(),
            fineness: FINENESS[0],
            error: 0.0,
        };
        let mut fragments = 0;
        for left in (0..width).step_by(TILE) {
            let size = [TILE.min(width - left), rows];
            let drawn = |x: usize, y: usize| picture.mask.is_none_or(|mask| mask.get(left + x, band_y + y));
            let [across, down] = Mask::BLOCK;
            if (0..rows).step_by(down).all(|y| (0..size[0]).step_by(across).all(|x| !drawn(x, y))) {
                continue;
            }
            let tile = picture.tile([left, band.y], size, list, &mut scratch.nearby);
            for y in (0..rows).step_by(R) {
                for x in (0..size[0]).step_by(S::LANES) {
                    if drawn(x, y) {
                        fragments += match picture.gas.cut {
                            Cut::Equidistant { richardson, .. } => {
                                picture.block(s, &tile, [x, y], richardson, &mut scratch, &mut band)
                            }
                            Cut::Local => picture.local(s, &tile, [x, y], picture.error, &mut scratch, &mut band),
                        };
                    }
                }
            }
        }
        (fragments, scratch.error)
    }
}

impl Picture<'_> {
    /// Tangents of the ray through the centre of a pixel.
    fn corner(&self, pixel: [usize; 2]) -> [f64; 2] {
        let [x, y] = pixel.map(|number| number as f64 + 0.5);
        let direction = self.view.direction(x, y);
        [direction.x, direction.y]
    }

    /// Tangents from pixel to pixel.
    fn step(&self) -> [f64; 2] {
        let focal = self.view.focal_px();
        [1.0 / focal.x, -1.0 / focal.y]
    }

    /// Lists the particles of a tile and finds their colours.
    fn tile(&self, at: [usize; 2], size: [usize; 2], list: &[u32], nearby: &mut Nearby) -> Tile {
        let width = self.view.size[0] as usize;
        let background = self.background;
        let opaque = self.opaque.map(|layer| survey(layer, background, width, at, size));
        // Rounded outwards: a particle that the surface may touch is cut by it.
        let [nearest, farthest] = opaque
            .as_ref()
            .map_or([f32::INFINITY; 2], |opaque| [opaque.nearest.next_down(), opaque.farthest.next_up()]);
        let [x0, x1] = [at[0] as u32, (at[0] + size[0]) as u32];
        let mut palette = [[0.0; 3]; FEW];
        let mut colors = 0;
        nearby.clear();
        let corner = self.corner(at);
        for &i in list {
            let (ball, bounds) = (&self.balls[i as usize], &self.bounds[i as usize]);
            if bounds.x[0] < x1 && bounds.x[1] >= x0 && ball.depths[0] <= farthest {
                let known = palette[..colors.min(FEW)].iter().position(|&color| color == ball.color);
                let color = known.unwrap_or_else(|| {
                    if colors < FEW {
                        palette[colors] = ball.color;
                    }
                    colors += 1;
                    colors - 1
                });
                nearby.push(i, color.min(FEW) as u8, ball.center, corner);
                colors = colors.min(FEW + 1);
            }
        }
        nearby.pad();
        Tile {
            at,
            size,
            palette: (colors <= FEW).then_some((palette, colors)),
            nearest,
            stop: stop_transmittance(self.gas.tolerance, &self.gas.range, background, opaque.as_ref()),
        }
    }

    /// The rays of the block at `at` of a tile.
    #[inline(always)]
    fn rays<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        corner: [f64; 2],
        step: [f64; 2],
    ) -> Rays<S::F, R> {
        let zero = s.splat(0.0);
        let ramp = s.ramp();
        let x = s.mul_add(ramp, s.splat(step[0] as f32), s.splat(corner[0] as f32));
        let square = s.mul_add(x, x, s.splat(1.0));
        let infinite = [s.splat(f32::INFINITY), zero];
        let mut rays = Rays {
            x,
            y: [0.0; R],
            length: [zero; R],
            inverse: [zero; R],
            weight: [zero; R],
            wall: [infinite; R],
            ramp,
        };
        for r in 0..R {
            let y = (corner[1] + r as f64 * step[1]) as f32;
            let square = s.add(square, s.splat(y * y));
            rays.y[r] = y;
            rays.length[r] = s.sqrt(square);
            rays.inverse[r] = s.div(s.splat(1.0), rays.length[r]);
            rays.weight[r] = s.div(s.splat(1.0), square);
            if let Some(layer) = self.opaque
                && at[1] + r < tile.size[1]
                && tile.nearest < f32::INFINITY
            {
                let mut parts = [[f32::INFINITY; 16], [0.0; 16]];
                let row = (tile.at[1] + at[1] + r) * self.view.size[0] as usize + tile.at[0] + at[0];
                let depths = &layer.depth[row..row + S::LANES.min(tile.size[0] - at[0])];
                for (lane, &depth) in depths.iter().enumerate() {
                    if depth < f64::INFINITY {
                        parts[0][lane] = depth as f32;
                        parts[1][lane] = (depth - f64::from(depth as f32)) as f32;
                    }
                }
                rays.wall[r] = [s.load(&parts[0]), s.load(&parts[1])];
            }
        }
        rays
    }

    /// Draws a block of pixels; returns the fragments.
    #[inline(always)]
    fn block<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        richardson: bool,
        scratch: &mut Scratch<S, R>,
        band: &mut Band,
    ) -> u64 {
        let zero = s.splat(0.0);
        let step = self.step();
        let corner = self.corner([tile.at[0] + at[0], tile.at[1] + at[1]]);
        let rays = self.rays(s, tile, at, corner, step);
        // Whether the pictures of fewer slabs are wanted too.
        let merge = richardson || band.error.is_some();
        // One colour needs one slab.
        let split = tile.palette.is_none_or(|(_, colors)| colors > 1) && self.planes.len() > 1;
        let quick = self.gas.quick && !split && !merge && tile.palette.is_some();
        let mut sums = Sums::new(s);
        let Scratch { slots, legs, nearby, .. } = scratch;
        // Slabs before `done` are composited; from `filled` on they are empty.
        let (mut done, mut filled) = (0, 0);
        // Behind this slab nothing is seen, by what is in the slabs already.
        let mut seen = self.planes.len() - 1;
        let mut hits = 0u64;
        let beam = Beam::new(self.corner(tile.at), step, at, [S::LANES, R]);
        let mut met = [Hit::default(); 16];
        'gas: for start in (0..nearby.count()).step_by(S::LANES) {
            let count = nearby.meet(s, start, &beam, &mut met);
            for hit in &met[..count] {
                let ball = &self.balls[hit.ball as usize];
                let [mut first, mut last] = ball.slabs.map(usize::from);
                if !split {
                    [first, last] = [0, 0];
                    if hits % 16 == 15 {
                        let mut least = slots[0][0][0];
                        for row in &slots[0][1..] {
                            least = s.min(least, row[0]);
                        }
                        if s.reduce_min(least) >= -tile.stop.log2() {
                            break 'gas;
                        }
                    }
                }
                if first > seen {
                    break 'gas;
                }
                // Slabs are merged by four.
                let ready = if merge { first & !3 } else { first };
                if ready > done {
                    let end = ready.min(filled.max(done));
                    composite(s, tile, merge, &mut slots[done..end], done, &mut sums);
                    done = ready;
                    if let Some(last) = last_seen(s, tile, &slots[done..filled.max(done)], &sums) {
                        let last = done + last;
                        seen = seen.min(if merge { last | 3 } else { last });
                        if first > seen {
                            break 'gas;
                        }
                    }
                }
                let cut = last > seen;
                last = last.min(seen);
                filled = filled.max(last + 1);
                hits += 1;
                let fragment = Fragment {
                    ball,
                    rays: &rays,
                    corner,
                    step,
                    planes: &self.planes[first..],
                    span: ball.span(hit.depths, last - first + usize::from(cut)),
                    wall: ball.depths[1] >= tile.nearest,
                    thick: !merge && ball.step >= THICK,
                };
                let slots = &mut slots[first..=last];
                if quick && let (Shape::Gaussian, false) = (ball.shape, fragment.is_clipped()) {
                    fragment.gaussian(s, hit.color, &mut slots[0]);
                } else if tile.palette.is_some() {
                    fragment.shape::<S, true>(s, hit.color, &self.gas.shells, slots, legs);
                } else {
                    fragment.shape::<S, false>(s, hit.color, &self.gas.shells, slots, legs);
                }
            }
        }
        let end = filled.min(seen + 1);
        if done < end {
            composite(s, tile, merge, &mut slots[done..end], done, &mut sums);
        }
        if end < filled {
            slots[end.max(done)..filled].fill([[zero; 4]; R]);
        }
        if richardson {
            let (light, off) = sums.extrapolated(s);
            self.develop(s, tile, at, &light, &sums.through, Some(&off), band);
        } else if merge {
            let off = sums.step(s);
            self.develop(s, tile, at, &sums.light[0], &sums.through, Some(&off), band);
        } else {
            self.develop(s, tile, at, &sums.light[0], &sums.through, None, band);
        }
        hits * (S::LANES * R) as u64
    }

    /// Draws a block of pixels in slabs of its own, finer ones until their estimate of the error is at most `most`; returns
    /// the fragments.
    #[inline(always)]
    fn local<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        most: f32,
        scratch: &mut Scratch<S, R>,
        band: &mut Band,
    ) -> u64 {
        let zero = s.splat(0.0);
        let step = self.step();
        let Scratch { slots, legs, nearby, local, fineness, error } = scratch;
        let beam = Beam::new(self.corner(tile.at), step, at, [S::LANES, R]);
        let stretch = beam.longest();
        let mut hits = [Hit::default(); 16];
        local.clear();
        for start in (0..nearby.count()).step_by(S::LANES) {
            let count = nearby.meet(s, start, &beam, &mut hits);
            for hit in &hits[..count] {
                local.push(&self.balls[hit.ball as usize], hit, stretch);
            }
        }
        if local.met.is_empty() {
            self.develop(s, tile, at, &[[zero; 3]; R], &[s.splat(1.0); R], None, band);
            return 0;
        }
        let corner = self.corner([tile.at[0] + at[0], tile.at[1] + at[1]]);
        let rays = self.rays(s, tile, at, corner, step);
        if tile.nearest < f32::INFINITY {
            local.end(self.farthest(s, &rays));
        }
        local.sort();
        local.group(self.balls, most);
        // Optical depth that goes to the slab beside its own is lost among the rest.
        let coarse = most > COARSE;
        let few = tile.palette.is_some();
        let enough = -tile.stop.log2();
        let mut fragments = 0;
        let mut floor = FINENESS[1];
        loop {
            local.cut(self.balls, few, *fineness);
            let mut light = Light::new(s);
            slots.resize(slots.len().max(local.planes.len()), [[zero; 4]; R]);
            // Units before `done` are composited, slabs from `filled` on are empty, those from `end` on are not seen.
            let (mut done, mut filled, mut end) = (0, 0, local.planes.len());
            // The least optical depth of a ray is not more.
            let mut could = 0.0;
            for met in &local.met {
                let [first, mut last] = met.slabs.map(|slab| slab as usize);
                if first >= end {
                    break;
                }
                if local.units[done].end <= first {
                    while local.units[done].end <= first {
                        self.unit(s, few, local, done, slots, &mut light);
                        done += 1;
                    }
                    let start = local.units[done].end - local.units[done].count;
                    if could >= enough {
                        match light.least(s, &slots[start..filled.max(start)], few, enough) {
                            Ok(seen) => {
                                let seen = local.units[done..].iter().find(|unit| unit.end > start + seen);
                                end = end.min(seen.map_or(end, |unit| unit.end));
                                if first >= end {
                                    break;
                                }
                            }
                            Err(least) => could = least,
                        }
                    }
                }
                could += met.depth * LOG2_E;
                let cut = last >= end;
                last = last.min(end - 1);
                filled = filled.max(last + 1);
                fragments += (S::LANES * R) as u64;
                let ball = &self.balls[met.ball as usize];
                let fragment = Fragment {
                    ball,
                    rays: &rays,
                    corner,
                    step,
                    planes: &local.planes[first..],
                    span: [0, last - first + usize::from(cut)],
                    wall: met.depths[1] >= tile.nearest,
                    // Thin slabs of dense gas may hold less than shares are off.
                    thick: coarse && met.depth < 1.0 && last - first <= COARSEST,
                };
                let slots = &mut slots[first..=last];
                if tile.palette.is_some() {
                    fragment.shape::<S, true>(s, met.color, &self.gas.shells, slots, legs);
                } else {
                    fragment.shape::<S, false>(s, met.color, &self.gas.shells, slots, legs);
                }
            }
            let mut start = 0;
            for (number, unit) in local.units.iter().enumerate().skip(done) {
                start = unit.end - unit.count;
                if start >= filled || start >= end {
                    break;
                }
                self.unit(s, few, local, number, slots, &mut light);
                start = unit.end;
            }
            if start < filled {
                slots[start..filled].fill([[zero; 4]; R]);
            }
            let (color, [estimate, rough]) = light.finish(s, tile.palette.as_ref().map(|(palette, _)| palette));
            let estimate = (local.doubt * estimate).max(local.distrust * rough);
            let share = estimate / (most - local.lost);
            let [_, least, widest] = FINENESS;
            // What is not seen is not lost.
            let spilled = if local.spills < end { local.spilled } else { 0.0 };
            if spilled > 0.0 && *fineness < widest {
                // Not finer than there are slabs for, and then what that gives.
                *fineness = (1.5 * *fineness).min(widest);
                floor = *fineness;
                continue;
            }
            if share <= 1.0 || *fineness <= floor {
                *error = error.max(local.lost + estimate + spilled);
                self.develop(s, tile, at, &color, &light.through, None, band);
                // What the next block starts with.
                if estimate > 0.0 {
                    let change = (0.8 / share.max(1e-6).sqrt().sqrt()).clamp(0.7, 1.3);
                    *fineness = (*fineness * change).clamp(least, widest);
                }
                return fragments;
            }
            // Of at least the second order, mostly of the fourth.
            *fineness = (*fineness * (0.9 / share.cbrt()).clamp(0.3, 0.8)).max(least);
        }
    }

    /// Composites a block's unit.
    #[inline(always)]
    fn unit<S: Simd, const R: usize>(
        &self,
        s: S,
        few: bool,
        local: &Local,
        number: usize,
        slots: &mut [Slot<S::F, R>],
        light: &mut Light<S::F, R>,
    ) {
        let unit = local.units[number];
        let slots = &mut slots[unit.end - unit.count..unit.end];
        if let Some(met) = unit.alone {
            let met = &local.met[met as usize];
            let color = &self.balls[met.ball as usize].color;
            light.alone(s, &mut slots[0], few, met.color.into(), color);
        } else if let Ok(four) = slots.try_into() {
            light.four(s, four, few);
        } else {
            light.whole(s, &mut slots[0], few);
        }
    }

    /// The depth behind which no ray of a block sees gas.
    #[inline(always)]
    fn farthest<S: Simd, const R: usize>(&self, s: S, rays: &Rays<S::F, R>) -> f32 {
        let mut far = rays.wall[0][0];
        for [depth, _] in &rays.wall[1..] {
            far = s.max(far, *depth);
        }
        s.reduce_max(far).next_up()
    }

    /// Writes a block's pixels to the film: light over what is behind, and transmittance to the background.
    #[inline(always)]
    fn develop<S: Simd, const R: usize>(
        &self,
        s: S,
        tile: &Tile,
        at: [usize; 2],
        light: &[[S::F; 3]; R],
        through: &[S::F; R],
        off: Option<&[S::F; R]>,
        band: &mut Band,
    ) {
        let width = self.view.size[0] as usize;
        let background = self.background;
        let lanes = S::LANES.min(tile.size[0] - at[0]);
        let plain = lanes == S::LANES && tile.nearest == f32::INFINITY;
        for r in 0..R.min(tile.size[1] - at[1]) {
            let line = (at[1] + r) * width + tile.at[0] + at[0];
            let mut values = [[0.0f32; 16]; 3];
            if let (Some(error), Some(off)) = (&mut band.error, off) {
                s.store(off[r], &mut values[0]);
                error[line..line + lanes].copy_from_slice(&values[0][..lanes]);
            }
            if plain {
                let [color @ .., transmittance] = &mut band.planes;
                for ((plane, &behind), &light) in color.iter_mut().zip(&background).zip(&light[r]) {
                    s.store(s.mul_add(through[r], s.splat(behind), light), &mut plane[line..]);
                }
                s.store(through[r], &mut transmittance[line..]);
                continue;
            }
            let layer = self.opaque.map(|layer| (layer, line + band.y * width));
            let mut seen = [0.0f32; 16];
            s.store(through[r], &mut seen);
            for (values, &light) in values.iter_mut().zip(&light[r]) {
                s.store(light, values);
            }
            for lane in 0..lanes {
                let hit = layer.filter(|(layer, first)| layer.depth[first + lane] < f64::INFINITY);
                let behind = hit.map_or(background, |(layer, first)| layer.color[first + lane]);
                for channel in 0..3 {
                    band.planes[channel][line + lane] = seen[lane] * behind[channel] + values[channel][lane];
                }
                band.planes[3][line + lane] = if hit.is_some() { 0.0 } else { seen[lane] };
            }
        }
    }
}
