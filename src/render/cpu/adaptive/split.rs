//! How the tolerance is split among the savings that lose some of it: as it is predicted to take the least time.
//!
//! Slabs and nodes share what rays that end early leave of a tolerance. Slabs are the fewer the more they may lose; where nodes miss what
//! those leave, their tiles go on to a grid twice as fine; and a grid that nearly all of its tiles leave is drawn for nothing. What nodes
//! are likely to lose a sample of the particles tells, or the grid before.

use super::SPACINGS;
use super::misfit::{self, Trust};
use crate::render::cpu::forecast::Sample;
use crate::render::cpu::slab::Mask;
use crate::render::cpu::tile::TILE;

/// The time that slabs take falls with this power of what they may lose: their error is of the third to the fourth order in their
/// thickness. (Twice as much for them takes a fifth off the nodes of the walks with three colours.)
const ORDER: f64 = 1.0 / 3.0;

/// What slabs may lose, as shares of the tolerance, that are tried: not more, since their estimate may be off by a factor of two
/// (`slab/local.rs`). At 1/255 a little more than a quarter is the least with which shares of slabs may be less exact (`slab/block.rs`).
const SLABS: [f64; 3] = [0.26, 0.3, MOST];

/// The most that is tried, and what slabs of single pixels may lose, which have no nodes.
pub const MOST: f64 = 0.4;

/// Mean depth of a picture from which balls overlap everywhere, so that all of it is cut.
const CUT: f64 = 1.2;

/// What slabs come to lose of that, in the mean.
const USED: f64 = 0.93;

/// Time for the nodes of the next grid, or for the pixels, over that for the nodes of a grid.
const NEXT: f64 = 3.5;

/// What nodes lose over what those of the grid before lost: of balls of Gaussians, and of others, whose least radius is smaller.
const GAIN: [f64; 2] = [0.55, 0.36];

/// How far logarithms of what nodes lose lie from what is expected (standard deviations): over pictures, and in a picture from tile to
/// tile; of balls of Gaussians and of others. Pictures are the more even the deeper they are, from a depth on. Over pictures it takes
/// Gauss and Hermite's three values and weights.
const DOUBT: [f64; 2] = [0.18, 0.45];
const TILES: [f64; 2] = [0.42, 0.6];
const EVEN: f64 = 1.2;
const VALUES: [[f64; 2]; 3] = [[-1.732, 1.0 / 6.0], [0.0, 2.0 / 3.0], [1.732, 1.0 / 6.0]];

/// What a view's nodes are expected to lose.
#[derive(Clone, Copy, Debug)]
pub struct Outlook {
    pub sample: Sample,
    /// The greatest [`Trust::loss`](super::misfit::Trust) of its particles.
    pub trust: f64,
    /// What slabs and nodes may lose together, as a share of the tolerance.
    pub left: f64,
    pub tolerance: f64,
}

impl Outlook {
    /// What nodes of a grid lose in the middle of a picture's tiles. Fitted to 84 pictures of Gaussians of two to four colours, opacities
    /// of 0.02 to 0.6 and mean depths of 0.2 to 16, at three tolerances: it is within 1.2 of two thirds of them. Of other kernels it
    /// is within a factor of 2.
    fn loss(&self, grid: usize) -> f64 {
        let Sample { depth, own, widest, .. } = self.sample;
        // Where a picture is deepest.
        let share = misfit::share(self.trust, (-1.5 * depth).exp() as f32, false);
        // At half of that distance a fit to the first grids, from there on the gain.
        let halvings = (2.0 * SPACINGS[grid] as f64 / widest).log2();
        0.039 * share * own.powf(0.82) * (-0.43 * depth.min(5.0)).exp() * self.gain().powf(-halvings)
    }

    /// 1 if some of the balls are no Gaussians.
    fn is_other(&self) -> usize {
        usize::from(self.trust > Trust::GAUSSIAN)
    }

    fn gain(&self) -> f64 {
        GAIN[self.is_other()]
    }

    /// What slabs may lose, as a share of the tolerance, on some tiles of a grid, by what nodes lost of each on the last grid that was
    /// asked, if one was: that, and how many grids ago. `None` if most of them are likely to go on all the same, so that it takes
    /// less time to leave this grid out. Not of no tiles.
    pub fn slabs(&self, grid: usize, tiles: &[Option<(f64, usize)>]) -> Option<f64> {
        // No grid may follow any ball of the sample: tiles that are here all the same hold others.
        let forecast = if self.sample.widest > 0.0 { self.loss(grid) } else { 0.0 };
        let log = |tile: &Option<(f64, usize)>| {
            let loss = tile.map_or(forecast, |(loss, ago)| loss * self.gain().powi(ago as i32));
            (loss / self.tolerance).clamp(1e-6, 1e6).ln()
        };
        let count = tiles.len() as f64;
        let mean = tiles.iter().map(log).sum::<f64>() / count;
        let variance = tiles.iter().map(|tile| (log(tile) - mean).powi(2)).sum::<f64>() / count;
        let is_other = self.is_other();
        let own = TILES[is_other] * (EVEN / self.sample.depth).min(1.0);
        let deviation = (variance + own * own).sqrt();
        let cases = VALUES.map(|[value, weight]| {
            let mean = mean + value * DOUBT[is_other];
            (weight, mean, NEXT * self.best(grid + 1, mean + self.gain().ln(), deviation))
        });
        let (share, time) = least(|slabs| {
            let time = |&(weight, mean, after)| weight * self.time(grid, slabs, mean, deviation, after);
            cases.iter().map(time).sum()
        });
        let without: f64 = cases.iter().map(|(weight, _, after)| weight * after).sum();
        (time <= without).then_some(share)
    }

    /// Time from a grid on, over that for its nodes by the fewest slabs, with what is best for slabs; the
    /// pixels come after the last. Logarithms of what nodes lose on tiles have that mean and deviation.
    fn best(&self, grid: usize, mean: f64, deviation: f64) -> f64 {
        if grid == SPACINGS.len() {
            return self.price(MOST);
        }
        let after = NEXT * self.best(grid + 1, mean + self.gain().ln(), deviation);
        least(|slabs| self.time(grid, slabs, mean, deviation, after)).1
    }

    /// The same if slabs may lose so much, and the time from the next grid on is that.
    fn time(&self, grid: usize, slabs: f64, mean: f64, deviation: f64, after: f64) -> f64 {
        let left = (self.left - USED * slabs).max(1e-6);
        // A normal distribution is a logistic one, near enough.
        let missed = 1.0 / (1.0 + ((left.ln() - mean) / (0.55 * deviation)).exp());
        // A tile that goes on takes blocks of nodes that other tiles may ask for too.
        let next = SPACINGS.get(grid + 1).map_or(1.0, |&spacing| spacing as f64);
        let sharing: f64 =
            Mask::BLOCK.map(|nodes| (nodes as f64 + 6.0) * next / TILE as f64 + 1.0).into_iter().product();
        self.price(slabs) + after * (1.0 - (1.0 - missed).powf(sharing))
    }

    /// Time for slabs that may lose so much, over that for those that may lose the most. In thin gas there is little
    /// to cut.
    fn price(&self, slabs: f64) -> f64 {
        1.0 + (self.sample.depth / CUT).min(1.0) * ((slabs / MOST).powf(-ORDER) - 1.0)
    }
}

/// What slabs may lose that takes the least time, and that; of equals the first.
fn least(time: impl Fn(f64) -> f64) -> (f64, f64) {
    let times = SLABS.iter().map(|&slabs| (slabs, time(slabs)));
    times.fold((SLABS[0], f64::INFINITY), |best, own| if own.1 < best.1 { own } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: f64 = 1.0 / 255.0;

    fn outlook(depth: f64, own: f64, widest: f64, tolerance: f64) -> Outlook {
        let sample = Sample { depth, own, widest, ..Sample::default() };
        Outlook { sample, trust: Trust::GAUSSIAN, left: 0.9, tolerance }
    }

    /// What was measured on the walks with three colours: the median over the tiles.
    #[test]
    fn what_nodes_lose_is_forecast() {
        for (depth, own, widest, found) in [
            (1.45, 0.105, 34.5, 0.156),
            (7.0, 0.511, 34.5, 0.355),
            (3.03, 0.105, 37.5, 0.096),
            (14.7, 0.511, 37.5, 0.360),
            (1.96, 0.105, 29.7, 0.182),
            (9.5, 0.511, 29.7, 0.404),
        ] {
            let loss = outlook(depth, own, widest, TOLERANCE).loss(0) / TOLERANCE;
            assert!(loss / found > 0.75 && loss / found < 1.34, "depth {depth}, {own}: {loss} for {found}");
        }
    }

    /// Slabs get what nodes do not need; a grid that nearly all would leave for the next is left out.
    #[test]
    fn slabs_get_what_nodes_leave() {
        let some = [None; 192];
        let share = |own: f64, tolerance: f64| outlook(2.0, own, 30.0, tolerance).slabs(0, &some);
        assert_eq!(share(0.005, TOLERANCE), Some(MOST));
        let shares = [0.02, 0.05, 0.1, 0.2, 0.3].map(|own| share(own, TOLERANCE).unwrap());
        assert!(shares.is_sorted_by(|a, b| a >= b) && shares[0] > shares[4], "{shares:?}");
        assert_eq!(share(0.9, TOLERANCE / 10.0), None);
        // Tiles that were asked before tell more than the sample does.
        let one = outlook(2.0, 0.2, 30.0, TOLERANCE);
        let known = |loss: f64| one.slabs(1, &[Some((loss * TOLERANCE, 1)); 9]);
        assert_eq!(known(1e-3), Some(MOST));
        assert!(known(0.8) < known(0.4));
        assert_eq!(known(20.0), None);
        // The pixels would follow, which take far longer.
        assert_eq!(one.slabs(SPACINGS.len() - 1, &[Some((TOLERANCE, 1))]), Some(SLABS[0]));
        // What was lost two grids ago tells of less than what was lost on the last.
        let ago = |ago| one.slabs(2, &[Some((0.9 * TOLERANCE, ago))]);
        assert!(ago(1) < ago(2), "{:?} {:?}", ago(1), ago(2));
        // Where no grid may follow what the sample holds, tiles of other balls are drawn as if nothing were known.
        assert_eq!(outlook(2.0, 0.0, 0.0, TOLERANCE).slabs(0, &some), Some(MOST));
        // Whatever is known, slabs may lose something.
        for (depth, own, widest) in
            [(0.0, 0.0, 0.0), (2.0, 0.2, 0.0), (0.0, 0.2, 30.0), (2.0, 0.0, 30.0), (90.0, 1e3, 1e-9)]
        {
            for tolerance in [1e-300, 1e-9, TOLERANCE, 1e9] {
                let shares = [0, 1, 2, 3].map(|grid| outlook(depth, own, widest, tolerance).slabs(grid, &some));
                let is_sound = |share: &Option<f64>| share.is_none_or(|share| SLABS.contains(&share));
                assert!(shares.iter().all(is_sound), "{depth}, {own}, {widest}, {tolerance:e}: {shares:?}");
            }
        }
        assert_eq!(outlook(2.0, 0.2, 30.0, 1e-300).slabs(0, &some), None);
    }
}
