//! Wall time of stages that tasks go through side by side.

use std::time::{Duration, Instant};

/// How long each of `N` stages of a task took.
#[derive(Clone, Copy, Debug)]
pub struct Laps<const N: usize>([Duration; N]);

impl<const N: usize> Default for Laps<N> {
    fn default() -> Self {
        Self([Duration::ZERO; N])
    }
}

impl<const N: usize> Laps<N> {
    /// Does the work of a stage.
    pub fn time<R>(&mut self, stage: usize, work: impl FnOnce() -> R) -> R {
        let start = Instant::now();
        let result = work();
        self.0[stage] += start.elapsed();
        result
    }

    /// What of the wall time of all tasks went to each stage, by what each took of the tasks, waiting for others included.
    pub fn shares(tasks: &[Self], wall: Duration) -> [Duration; N] {
        let sums: [f64; N] = std::array::from_fn(|stage| tasks.iter().map(|laps| laps.0[stage].as_secs_f64()).sum());
        let all: f64 = sums.iter().sum();
        sums.map(|sum| if all > 0.0 { wall.mul_f64(sum / all) } else { Duration::ZERO })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wall_time_is_shared_out_by_what_stages_took() {
        let ms = Duration::from_millis;
        let tasks = [Laps([ms(1), ms(3)]), Laps([ms(2), ms(2)])];
        assert_eq!(Laps::shares(&tasks, ms(8)), [ms(3), ms(5)]);
        assert_eq!(Laps::shares(&[Laps::<2>::default()], ms(8)), [Duration::ZERO; 2]);
        let mut laps = Laps::<2>::default();
        assert_eq!(laps.time(1, || 7), 7);
        assert_eq!(laps.0[0], Duration::ZERO);
    }
}
