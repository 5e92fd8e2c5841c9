//! The same scene with more or fewer particles.

use super::particles::{DEFAULT_RADIUS, MAX_BOX_COUNT, ParticleEntry, Source};

/// Gives the boxes of a scene `total` particles in all, at least 1, shared out as they are now, and changes radii with the
/// cube root of the count's inverse, so that as much of space is filled as before.
///
/// The error says, for a set from a file, too many particles, or none to begin with, what is allowed.
pub fn populate(entries: &mut [ParticleEntry], total: u64) -> Result<(), String> {
    if !(1..=MAX_BOX_COUNT).contains(&total) {
        return Err(format!("{total} particles; allowed: 1 to {MAX_BOX_COUNT}"));
    }
    let mut counts = Vec::with_capacity(entries.len());
    for (i, entry) in entries.iter().enumerate() {
        match &entry.source {
            Source::Box { count, .. } => counts.push(*count),
            Source::File(path) => {
                let (number, path) = (i + 1, path.display());
                return Err(format!("[[particles]] {number} comes from {path}; allowed: particles in boxes alone"));
            }
        }
    }
    let before: u128 = counts.iter().copied().map(u128::from).sum();
    if before == 0 {
        return Err("the scene has no particles; allowed: particles in boxes".into());
    }
    let factor = (before as f64 / total as f64).cbrt();
    let (mut sum, mut given) = (0, 0);
    for (entry, old) in entries.iter_mut().zip(counts) {
        // What is given up to each set is rounded, so that all of them together are exactly `total`.
        sum += u128::from(old);
        let until = (sum * u128::from(total) / before) as u64;
        match &mut entry.source {
            Source::Box { count, .. } => *count = until - given,
            Source::File(_) => {}
        }
        given = until;
        entry.radius = Some(entry.radius.unwrap_or(DEFAULT_RADIUS) * factor);
    }
    Ok(())
}
