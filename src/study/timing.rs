//! How long frames take.

use std::time::Duration;

use crate::error::Result;
use crate::render::Statistics;
use crate::scene::Scene;

/// What warming up takes at the least, however few frames are asked for: new threads come to share a core, and the system takes some
/// milliseconds to part them.
pub const SETTLE: Duration = Duration::from_millis(20);

/// Frames for that, at the most.
const MOST: u32 = 10_000;

/// How far the camera moves from frame to frame, scene units.
pub const STEP: f64 = 1e-4;

/// What measured frames took.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// Frames that were measured, at least 1.
    pub frames: u32,
    /// Median wall time of a frame.
    pub median: Duration,
    /// The fastest frame.
    pub min: Duration,
    /// How far the middle half of the frames lies apart: third less first quartile.
    pub spread: Duration,
    /// Median of each stage, in the order in which they run.
    pub stages: Vec<(&'static str, Duration)>,
    /// Fragments of the last frame.
    pub fragments: u64,
    /// What the method foretold of its stages in the last frame, where it does.
    pub predicted: Option<Duration>,
}

impl Timing {
    /// What frames took, of which there is at least one.
    pub fn new(measured: &[Statistics]) -> Self {
        let totals = sorted(measured.iter().map(|frame| frame.total));
        // The stages of a method are the same in every frame; one that a frame does without took no time there.
        let names = measured.first().map_or(&[][..], |frame| &frame.stages);
        let stages = names.iter().map(|&(name, _)| {
            let time =
                |frame: &Statistics| frame.stages.iter().find(|stage| stage.0 == name).map_or(Duration::ZERO, |s| s.1);
            (name, quantile(&sorted(measured.iter().map(time)), 0.5))
        });
        Self {
            frames: measured.len() as u32,
            median: quantile(&totals, 0.5),
            min: quantile(&totals, 0.0),
            spread: quantile(&totals, 0.75) - quantile(&totals, 0.25),
            stages: stages.collect(),
            fragments: measured.last().map_or(0, |frame| frame.fragments),
            predicted: measured.last().and_then(|frame| frame.predicted_time),
        }
    }
}

/// Draws frames of a scene: `warmup` of them that are not measured, and more until they took [`SETTLE`], but none if that is 0; then
/// such that are, until `enough` says so of their number and of their time in all. Before every frame the camera moves [`STEP`] forward,
/// so that nothing can be kept from the frame before; in the end it stands where it stood. `draw` may change the scene, but has to leave
/// it as it was.
///
/// # Errors
/// The first of `draw`.
pub fn frames(
    scene: &mut Scene,
    warmup: u32,
    mut enough: impl FnMut(u32, Duration) -> bool,
    mut draw: impl FnMut(&mut Scene) -> Result<Statistics>,
) -> Result<Vec<Statistics>> {
    let (position, look_at) = (scene.camera.position, scene.camera.look_at);
    let forward = (look_at - position).normalize() * STEP;
    let mut measured: Vec<Statistics> = Vec::new();
    let (mut warm, mut settled, mut spent) = (0, Duration::ZERO, Duration::ZERO);
    let outcome = loop {
        scene.camera.position += forward;
        scene.camera.look_at += forward;
        match draw(scene) {
            Ok(statistics)
                if warm < warmup || (measured.is_empty() && (1..MOST).contains(&warm) && settled < SETTLE) =>
            {
                warm += 1;
                settled += statistics.total;
            }
            Ok(statistics) => {
                spent += statistics.total;
                measured.push(statistics);
                if enough(measured.len() as u32, spent) {
                    break Ok(());
                }
            }
            Err(error) => break Err(error),
        }
    };
    (scene.camera.position, scene.camera.look_at) = (position, look_at);
    outcome.map(|()| measured)
}

fn sorted(times: impl Iterator<Item = Duration>) -> Vec<Duration> {
    let mut times: Vec<Duration> = times.collect();
    times.sort_unstable();
    times
}

/// The value at a share of the sorted times, which are not empty.
fn quantile(sorted: &[Duration], share: f64) -> Duration {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}
