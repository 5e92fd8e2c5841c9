//! What the tests share: seeded random numbers, random gas, comparison of pictures, temporary folders.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use stereomist::picture::Film;
use stereomist::scene::{Attribute, Kernel, ParticleSet, Rgb};

/// Seeded random numbers that stay the same on every machine and with every library version.
pub struct Random(ChaCha8Rng);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let unit = (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        low + (high - low) * unit
    }

    /// Uniform in the box.
    pub fn point(&mut self, low: [f64; 3], high: [f64; 3]) -> [f64; 3] {
        [self.uniform(low[0], high[0]), self.uniform(low[1], high[1]), self.uniform(low[2], high[2])]
    }

    /// A colour with channels in [0, high).
    pub fn color(&mut self, high: f64) -> Rgb {
        [0; 3].map(|_| self.uniform(0.0, high) as f32)
    }
}

/// Every kernel: the named ones and a profile.
pub fn kernels() -> Vec<Kernel> {
    let mut kernels: Vec<Kernel> = Kernel::NAMES.iter().filter_map(|name| Kernel::from_name(name)).collect();
    kernels.push(Kernel::table(vec![0.0, 0.15, 0.4, 0.45, 0.8, 1.0], vec![1.0, 0.9, 0.7, 0.3, 0.25, 0.0]).unwrap());
    kernels
}

/// A set with the given centres, the same radius and opacity for all and white.
pub fn set(kernel: Kernel, centres: &[[f64; 3]], radius: f64, opacity: f64) -> ParticleSet {
    ParticleSet {
        kernel,
        x: centres.iter().map(|c| c[0]).collect(),
        y: centres.iter().map(|c| c[1]).collect(),
        z: centres.iter().map(|c| c[2]).collect(),
        radius: Attribute::Uniform(radius),
        opacity: Attribute::Uniform(opacity),
        color: Attribute::Uniform([1.0; 3]),
    }
}

/// Random gas in a box, each particle with its own radius, opacity and colour.
pub struct Gas {
    pub count: usize,
    pub low: [f64; 3],
    pub high: [f64; 3],
    pub radius: [f64; 2],
    pub opacity: [f64; 2],
    /// Largest colour channel.
    pub bright: f64,
}

impl Gas {
    pub fn draw(&self, random: &mut Random, kernel: Kernel) -> ParticleSet {
        let centres: Vec<_> = (0..self.count).map(|_| random.point(self.low, self.high)).collect();
        let mut each = |[low, high]: [f64; 2]| (0..self.count).map(|_| random.uniform(low, high)).collect();
        let (radius, opacity) = (each(self.radius), each(self.opacity));
        let color = (0..self.count).map(|_| random.color(self.bright)).collect();
        ParticleSet {
            radius: Attribute::Each(radius),
            opacity: Attribute::Each(opacity),
            color: Attribute::Each(color),
            ..set(kernel, &centres, 1.0, 0.0)
        }
    }
}

/// The largest difference of a channel, and of the transmittances; no number if one of them is none.
pub fn difference(a: &Film, b: &Film) -> f64 {
    let planes = a.color.iter().chain([&a.transmittance]).zip(b.color.iter().chain([&b.transmittance]));
    let off = planes.flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| f64::from((a - b).abs()));
    off.fold(0.0, |most, off| if most.is_nan() || off <= most { most } else { off })
}

/// What a picture and the true one differ by, over red, green, blue and transmittance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Difference {
    /// Pixels compared.
    pub pixels: usize,
    /// Pixels with a plane off by more than the limit (or not a number).
    pub over: usize,
    /// Of these, those that the truth calls fragile.
    pub over_fragile: usize,
    /// Pixels off by more than 0.05 that are not fragile.
    pub gross: usize,
    /// Largest difference at a pixel that is not fragile; infinite where one is not a number.
    pub max: f64,
    /// Largest difference at any pixel.
    pub max_any: f64,
    /// Sum of the squares of all differences.
    pub squares: f64,
    /// Where `max` is: picture, column, row, plane.
    pub worst: [usize; 4],
}

impl Difference {
    /// Adds picture number `index`, `film`, against the planes of the true one. `fragile` marks the pixels at which the
    /// truth itself jumps within rounding.
    pub fn add(&mut self, index: usize, film: &Film, truth: &[Vec<f64>; 4], fragile: &[bool], limit: f64) {
        let [width, height] = film.size.map(|n| n as usize);
        let planes = [&film.color[0], &film.color[1], &film.color[2], &film.transmittance];
        for plane in planes {
            assert_eq!(plane.len(), width * height, "a plane of the film has the wrong length");
        }
        assert!(truth.iter().all(|plane| plane.len() == width * height), "the pictures differ in size");
        for i in 0..width * height {
            let mut worst = 0.0;
            for (channel, (a, b)) in planes.iter().zip(truth).enumerate() {
                let off = (f64::from(a[i]) - b[i]).abs();
                let off = if off.is_nan() { f64::INFINITY } else { off };
                self.squares += off * off;
                worst = f64::max(worst, off);
                if off > self.max && !fragile[i] {
                    self.max = off;
                    self.worst = [index, i % width, i / width, channel];
                }
            }
            self.max_any = self.max_any.max(worst);
            self.pixels += 1;
            self.over += usize::from(worst > limit);
            self.over_fragile += usize::from(worst > limit && fragile[i]);
            self.gross += usize::from(worst > 0.05 && !fragile[i]);
        }
    }

    /// Root of the mean square difference over all pixels and planes.
    pub fn rmse(&self) -> f64 {
        (self.squares / (4 * self.pixels).max(1) as f64).sqrt()
    }

    /// What is wrong when more than one sound pixel in `one_in` is over the limit (none of the sound ones may be off by
    /// 0.05, and of the fragile ones few may be over the limit at all).
    pub fn verdict(&self, one_in: usize) -> Result<(), String> {
        let sound = self.over - self.over_fragile;
        if sound > self.pixels / one_in {
            return Err(format!("{sound} of {} pixels are over the limit: {self:?}", self.pixels));
        }
        if self.gross > 0 {
            return Err(format!("{} pixels are off by more than 0.05: {self:?}", self.gross));
        }
        if self.over_fragile > 1 + self.pixels / 1000 {
            return Err(format!("{} fragile pixels are over the limit: {self:?}", self.over_fragile));
        }
        Ok(())
    }
}

/// A fresh folder that vanishes with the value.
pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

/// Says that a check could not be made here, and why. Straight to stderr: the test runner hides what tests print.
pub fn skipped(what: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "SKIPPED: {what}");
}

/// A film with a gradient, and its planes in f64.
fn sample() -> (Film, [Vec<f64>; 4]) {
    let mut film = Film::new([40, 30]);
    let mut random = Random::new(1);
    let [red, green, blue] = &mut film.color;
    for plane in [red, green, blue, &mut film.transmittance] {
        plane.iter_mut().for_each(|v| *v = random.uniform(0.0, 1.0) as f32);
    }
    let [red, green, blue] = &film.color;
    let truth = [red, green, blue, &film.transmittance].map(|p| p.iter().map(|&v| f64::from(v)).collect());
    (film, truth)
}

#[test]
fn equal_pictures_pass() {
    let (film, truth) = sample();
    let mut difference = Difference::default();
    difference.add(0, &film, &truth, &[false; 1200], 1e-3);
    assert_eq!((difference.over, difference.max, difference.rmse()), (0, 0.0, 0.0));
    difference.verdict(10_000).unwrap();
}

/// A comparison that cannot fail is worth nothing: every planted difference must be found, in every plane.
#[test]
fn planted_differences_are_found() {
    for channel in 0..4 {
        for (planted, gross) in [(2e-3, 0), (0.1, 1), (f32::NAN, 1), (f32::INFINITY, 1)] {
            let (mut film, truth) = sample();
            let plane = if channel < 3 { &mut film.color[channel] } else { &mut film.transmittance };
            plane[7 * 40 + 11] += planted;
            let mut difference = Difference::default();
            difference.add(3, &film, &truth, &[false; 1200], 1e-3);
            assert_eq!((difference.over, difference.gross), (1, gross), "{channel} {planted}");
            assert_eq!(difference.worst, [3, 11, 7, channel]);
            assert!(difference.max > 1.9e-3 && difference.rmse() > 1e-5);
            assert!(difference.verdict(10_000).is_err());
            // One pixel in 1000 may be over the limit, but not grossly.
            assert_eq!(difference.verdict(1000).is_err(), gross > 0);
        }
    }
}

#[test]
fn fragile_pixels_are_counted_apart_and_may_not_be_many() {
    let (mut film, truth) = sample();
    film.color[0][100] += 0.5;
    let mut difference = Difference::default();
    difference.add(0, &film, &truth, &[true; 1200], 1e-3);
    assert_eq!((difference.over, difference.over_fragile, difference.gross, difference.max), (1, 1, 0, 0.0));
    assert!(difference.max_any > 0.4);
    difference.verdict(10_000).unwrap();
    film.color[0].iter_mut().for_each(|v| *v += 0.5);
    difference.add(0, &film, &truth, &[true; 1200], 1e-3);
    assert!(difference.verdict(10_000).is_err());
}

#[test]
fn random_numbers_keep_their_values_and_folders_vanish() {
    let mut random = Random::new(17);
    let first = random.uniform(0.0, 1.0);
    assert_eq!(first, Random::new(17).uniform(0.0, 1.0));
    assert!((0.0..1.0).contains(&first) && first != Random::new(18).uniform(0.0, 1.0));
    let path = {
        let folder = folder();
        std::fs::write(folder.path().join("x"), "x").unwrap();
        folder.path().to_path_buf()
    };
    assert!(!path.exists());
}
