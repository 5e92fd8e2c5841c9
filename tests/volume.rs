//! From the cells of a volume to particles: the integral of the extinction is kept.

use glam::DVec3;
use std::path::Path;
use stereomist::input::particles::{CELL_RADIUS, MAX_OPACITY, from_columns};
use stereomist::input::{Cells, Column, ColumnMap, Columns, ParticleEntry, Source, Target};
use stereomist::scene::{Kernel, ParticleSet};

/// Four cells of volume 8 in a row.
fn columns(density: [f64; 4]) -> Columns {
    let column = |name: &str, values: [f64; 4]| Column { name: name.into(), values: values.to_vec(), byte: false };
    let columns = vec![
        column("x", [1.0, 3.0, 5.0, 7.0]),
        column("y", [2.0; 4]),
        column("z", [-1.0; 4]),
        column("smoke", density),
    ];
    let names = columns.iter().map(|column| column.name.clone()).collect();
    let mut columns = Columns::new(columns, names, 4, &[]).unwrap();
    columns.cells = Some(Cells { density: "smoke".into(), volume: 8.0 });
    columns
}

fn entry() -> ParticleEntry {
    crate::files::entry(Source::File("a.vdb".into()))
}

fn particles(entry: &ParticleEntry, density: [f64; 4]) -> Result<(ParticleSet, Vec<String>), String> {
    let mut notes = Vec::new();
    let set = from_columns(entry, columns(density), Path::new("a.vdb"), &mut notes).map_err(|e| e.to_string())?;
    Ok((set, notes))
}

/// Integral over space of a particle's extinction T0 k(q) / (r K(0)), by shells.
fn integral(set: &ParticleSet, i: usize) -> f64 {
    const SHELLS: usize = 4000;
    let radius = set.radius.get(i);
    let optical_depth = -(-set.opacity.get(i)).ln_1p();
    let shell = |s: usize| {
        let q = (s as f64 + 0.5) / SHELLS as f64;
        4.0 * std::f64::consts::PI * q * q * set.kernel.density(q) / SHELLS as f64
    };
    let content: f64 = (0..SHELLS).map(shell).sum();
    optical_depth / (radius * set.kernel.chord(0.0)) * radius.powi(3) * content
}

fn kernels() -> Vec<Kernel> {
    let mut kernels: Vec<Kernel> = Kernel::NAMES.iter().map(|name| Kernel::from_name(name).unwrap()).collect();
    kernels.push(Kernel::table(vec![0.0, 0.3, 1.0], vec![1.0, 2.0, 0.25]).unwrap());
    kernels
}

#[test]
fn the_content_of_a_kernel_is_its_integral_over_the_ball() {
    const STEPS: usize = 20_000;
    for kernel in kernels() {
        let step = |s: usize| {
            let q = (s as f64 + 0.5) / STEPS as f64;
            4.0 * std::f64::consts::PI * q * q * kernel.density(q) / STEPS as f64
        };
        let sum: f64 = (0..STEPS).map(step).sum();
        assert!((kernel.content() / sum - 1.0).abs() < 1e-7, "{}: {} {sum}", kernel.name(), kernel.content());
    }
}

#[test]
fn the_integral_of_the_extinction_is_kept() {
    let density = [0.0, 0.01, 0.2, 0.003];
    for kernel in kernels() {
        let placed = [
            entry(),
            ParticleEntry { radius: Some(3.0), ..entry() },
            ParticleEntry { scale: 0.25, ..entry() },
            ParticleEntry { scale: 7.0, radius: Some(2.5), rotation_deg: DVec3::new(10.0, 20.0, 30.0), ..entry() },
            ParticleEntry { fit: Some(60.0), ..entry() },
            ParticleEntry { fit: Some(60.0), radius: Some(30.0), ..entry() },
        ];
        for mut entry in placed {
            entry.kernel = kernel.clone();
            let (set, notes) = particles(&entry, density).unwrap();
            assert!(notes.is_empty());
            // An optical depth has no unit: in world units the extinction is divided by the scale.
            let scale = entry.fit.map_or(entry.scale, |fit| fit / 6.0);
            for (i, value) in density.iter().enumerate() {
                let expected = value / scale * 8.0 * scale.powi(3);
                let found = integral(&set, i);
                assert!((found - expected).abs() <= 1e-5 * expected, "{}: {found} {expected}", kernel.name());
            }
            assert_eq!(set.opacity.get(0), 0.0);
        }
    }
}

#[test]
fn a_cell_s_own_radius_is_two_of_its_sides() {
    let radius = |entry: ParticleEntry| particles(&entry, [0.1; 4]).unwrap().0.radius.get(0);
    assert_eq!(radius(entry()), CELL_RADIUS * 2.0);
    assert_eq!(radius(ParticleEntry { scale: 3.0, ..entry() }), 12.0);
    // With fit the data are 10 times as large, and so are the cells.
    assert_eq!(radius(ParticleEntry { fit: Some(60.0), ..entry() }), 40.0);
    assert_eq!(radius(ParticleEntry { fit: Some(60.0), radius: Some(1.5), ..entry() }), 1.5);
}

#[test]
fn a_volume_of_gaussians_is_smooth_inside() {
    // Sum over a lattice of spacing 1 of Gaussians of radius 2, each normalised to integral 1.
    let kernel = Kernel::Gaussian;
    let density = |x: f64, y: f64, z: f64| -> f64 {
        let mut sum = 0.0;
        for i in -3..=3 {
            for j in -3..=3 {
                for k in -3..=3 {
                    let d = DVec3::new(x - f64::from(i), y - f64::from(j), z - f64::from(k)).length();
                    sum += kernel.density(d / CELL_RADIUS) / (CELL_RADIUS.powi(3) * kernel.content());
                }
            }
        }
        sum
    };
    for (x, y, z) in [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.5, 0.0), (0.5, 0.5, 0.5), (0.2, 0.4, 0.1)] {
        let sum = density(x, y, z);
        assert!((sum - 1.0).abs() < 0.014, "{x} {y} {z}: {sum}");
    }
}

#[test]
fn a_grid_s_name_means_nothing() {
    let mut columns = columns([0.01; 4]);
    let mut density = columns.take("smoke").unwrap();
    density.name = "radius".into();
    let mut all: Vec<Column> = ["x", "y", "z"].into_iter().map(|name| columns.take(name).unwrap()).collect();
    all.push(density);
    let names = all.iter().map(|column| column.name.clone()).collect();
    let mut columns = Columns::new(all, names, 4, &[]).unwrap();
    columns.cells = Some(Cells { density: "radius".into(), volume: 8.0 });
    let set = from_columns(&entry(), columns, Path::new("a.vdb"), &mut Vec::new()).unwrap();
    let (same, _) = particles(&entry(), [0.01; 4]).unwrap();
    assert_eq!((set.radius, set.opacity), (same.radius, same.opacity));
}

#[test]
fn columns_change_the_extinction() {
    let mapped = |map: ColumnMap| ParticleEntry { columns: vec![map], ..entry() };
    let thick = ColumnMap { scale: 3.0, ..ColumnMap::plain(Target::Extinction, "smoke") };
    let (thin, _) = particles(&entry(), [0.01; 4]).unwrap();
    let (thick, _) = particles(&mapped(thick), [0.01; 4]).unwrap();
    assert!((integral(&thick, 0) / integral(&thin, 0) - 3.0).abs() < 1e-9);
    // An opacity of one's own takes the place of the extinction.
    let (own, _) = particles(&mapped(ColumnMap::plain(Target::Opacity, "smoke")), [0.01; 4]).unwrap();
    assert_eq!(own.opacity.get(2), 0.01);
}

#[test]
fn what_cannot_be_an_extinction_is_said() {
    let (set, notes) = particles(&entry(), [1e9, 0.1, 1e300, 0.1]).unwrap();
    assert_eq!([set.opacity.get(0), set.opacity.get(2)], [MAX_OPACITY; 2]);
    assert!(notes[0].contains("2 of 4 cells"), "{notes:?}");
    let (set, notes) = particles(&entry(), [0.1, -0.5, 0.1, 0.1]).unwrap();
    assert_eq!(set.opacity.get(1), 0.0);
    assert!(notes[0].contains("1 of 4 cells have a negative density"), "{notes:?}");
    let distances = particles(&entry(), [0.1, -0.5, -0.1, -0.1]).unwrap_err();
    assert!(distances.contains("3 of 4 cells") && distances.contains("0 or more"), "{distances}");
    let both = ["opacity", "extinction"].map(|name| ColumnMap::plain(Target::from_name(name).unwrap(), "smoke"));
    let message = particles(&ParticleEntry { columns: both.to_vec(), ..entry() }, [0.1; 4]).unwrap_err();
    assert!(message.contains("contradict"), "{message}");
    let table = Columns::new(vec![], vec![], 0, &[]).unwrap();
    let map = ParticleEntry { columns: vec![ColumnMap::plain(Target::Extinction, "smoke")], ..entry() };
    let message = from_columns(&map, table, Path::new("a.csv"), &mut Vec::new()).unwrap_err().to_string();
    assert!(message.contains("a.csv") && message.contains("volume"), "{message}");
}
