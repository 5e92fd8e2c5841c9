//! Left-right inconsistency: what of the right eye's error the left eye does not see at the same place in space.
//!
//! An error that both eyes see at one place looks like gas that is a little different; one that they see differently has no
//! place, and the eyes quarrel. The left eye's error is carried over to the right eye by the truth's disparity, that of the
//! mean depth of what each pixel shows, and subtracted: `E_R(x) - E_L(x + d(x))`, E = picture - truth in linear light. The
//! left error between pixel centres is linear along the row, in which both places lie.

use crate::error::{Error, Result};
use crate::picture::{Picture, Side};

/// The inconsistency over the pixels of the right eye that can be compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Inconsistency {
    /// Root mean square of red, green and blue, linear light; infinite where a sample has no finite value.
    pub rmse: [f64; 3],
    /// Largest absolute value of red, green and blue; infinite as `rmse`.
    pub max: [f64; 3],
    /// Column and row of the first pixel of the right eye with the largest value of all.
    pub max_at: [u32; 2],
    /// Channel of that value: 0, 1, 2 for red, green, blue.
    pub max_channel: usize,
    /// Pixels of the right eye that could be compared: those with a disparity that leads between the centres of the left
    /// picture's outermost columns. At least 1.
    pub pixels: u64,
    /// These as a share of all pixels, in (0, 1].
    pub share: f64,
    /// Samples (of `3 * pixels`) without a finite value.
    pub not_finite: u64,
    /// Root mean square of the right eye's own error over the same pixels and all channels, to measure [`Self::rmse`] by.
    pub own_rmse: f64,
    /// Largest absolute error of the right eye, of any channel, in the pixels that could not be compared: where the truth
    /// shows the background alone, or what the left picture does not hold. 0 without such pixels.
    pub left_out_max: f64,
}

impl Inconsistency {
    /// Root mean square over the three channels.
    pub fn rmse_of_all(&self) -> f64 {
        (self.rmse.iter().map(|rmse| rmse * rmse).sum::<f64>() / 3.0).sqrt()
    }

    /// Largest absolute value of any channel.
    pub fn max_of_all(&self) -> f64 {
        self.max[self.max_channel]
    }
}

/// The inconsistency, or in one line why there is none.
pub type Answer = std::result::Result<Inconsistency, String>;

/// The inconsistency of a stereo pair. `left` and `right` are a picture and its truth each, of one size, checked; the
/// disparity is the right truth's.
///
/// [`Error::Usage`] where the truths' disparities say that the eyes are swapped.
pub fn inconsistency(left: [&Picture; 2], right: [&Picture; 2]) -> Result<Answer> {
    for (truth, side, place) in [(left[1], Side::Left, "B"), (right[1], Side::Right, "B2")] {
        if let Some(disparity) = &truth.disparity
            && disparity.side != side
        {
            return Err(Error::Usage(format!(
                "the eyes are swapped: {place} is to be the {} eye's truth and has the {} eye's disparity, {}; allowed: \
                 left picture, left truth, right picture, right truth",
                side.name(),
                disparity.side.name(),
                disparity.side.channel()
            )));
        }
    }
    let Some(disparity) = &right[1].disparity else {
        return Ok(Err(format!(
            "the right eye's truth (B2) has no channel {}: `render --method reference --set \
             render.method.reference.disparity=true --image exr` writes one",
            Side::Right.channel()
        )));
    };
    if left[0].size != right[0].size {
        let [[lw, lh], [rw, rh]] = [left[0].size, right[0].size];
        return Ok(Err(format!("the eyes' pictures differ in size: {lw} x {lh} and {rw} x {rh}")));
    }
    let width = right[0].size[0] as usize;
    let (mut sums, mut own, mut left_out_max) = ([0.0; 3], 0.0, 0.0_f64);
    let mut max = [0.0_f64; 3];
    let (mut largest, mut at, mut max_channel) = (0.0, None, 0);
    let (mut pixels, mut not_finite) = (0u64, 0);
    for (i, &d) in disparity.x.iter().enumerate() {
        let Some(place) = Place::new(i % width, d.into(), width) else {
            left_out_max = (0..3).map(|c| size(error(right, c, i))).fold(left_out_max, f64::max);
            continue;
        };
        pixels += 1;
        for c in 0..3 {
            let here = error(right, c, i);
            let row = i - i % width;
            let there = place.between(|column| error(left, c, row + column));
            let value = size(here - there);
            own += size(here) * size(here);
            not_finite += u64::from(value.is_infinite());
            sums[c] += value * value;
            max[c] = max[c].max(value);
            if at.is_none() || value > largest {
                (largest, at, max_channel) = (value, Some(i), c);
            }
        }
    }
    let Some(at) = at else {
        return Ok(Err("no pixel of the right eye shows anything that the left picture holds too".into()));
    };
    Ok(Ok(Inconsistency {
        rmse: sums.map(|sum| (sum / pixels as f64).sqrt()),
        max,
        max_at: [(at % width) as u32, (at / width) as u32],
        max_channel,
        pixels,
        share: pixels as f64 / disparity.x.len() as f64,
        not_finite,
        own_rmse: (own / (3 * pixels) as f64).sqrt(),
        left_out_max,
    }))
}

/// Picture minus truth of a sample; 0 where both are the same infinity.
fn error([picture, truth]: [&Picture; 2], channel: usize, i: usize) -> f64 {
    let [a, b] = [picture, truth].map(|p| f64::from(p.color[channel][i]));
    if a == b { 0.0 } else { a - b }
}

/// Absolute value; infinity for NaN. As in the other metrics, what is no number passes no limit.
fn size(value: f64) -> f64 {
    if value.is_nan() { f64::INFINITY } else { value.abs() }
}

/// A place in a row of pixel centres.
pub(super) struct Place {
    column: usize,
    /// How far it is towards the next column, in [0, 1).
    part: f64,
}

impl Place {
    /// `d` pixels from a column of `width`; none if that is NaN or not between the centres of the first and the last.
    pub(super) fn new(column: usize, d: f64, width: usize) -> Option<Self> {
        let x = column as f64 + d;
        // NaN is in no range.
        (0.0..=(width - 1) as f64).contains(&x).then(|| Self { column: x as usize, part: x.fract() })
    }

    /// Linear between the two columns, of which a place on the first does not ask the second.
    pub(super) fn between(&self, mut value: impl FnMut(usize) -> f64) -> f64 {
        let first = value(self.column);
        if self.part == 0.0 { first } else { first + self.part * (value(self.column + 1) - first) }
    }
}
