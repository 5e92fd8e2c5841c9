//! The least and the greatest of many values.

/// Values that are looked at at once, each for itself, so that vectors of any machine do it.
const SIDE: usize = 8;

/// The least and the greatest of some values; what is no number is passed over.
pub struct Extent {
    low: [f32; SIDE],
    high: [f32; SIDE],
}

impl Extent {
    /// Of no values.
    pub const NOTHING: Self = Self { low: [f32::INFINITY; SIDE], high: [f32::NEG_INFINITY; SIDE] };

    /// With others.
    #[inline(always)]
    pub fn hold(&mut self, values: &[f32]) {
        let (whole, rest) = values.as_chunks::<SIDE>();
        for values in whole {
            for ((low, high), &value) in self.low.iter_mut().zip(&mut self.high).zip(values) {
                (*low, *high) = (less(value, *low), more(value, *high));
            }
        }
        for ((low, high), &value) in self.low.iter_mut().zip(&mut self.high).zip(rest) {
            (*low, *high) = (less(value, *low), more(value, *high));
        }
    }

    /// The least and the greatest; infinities the wrong way round of none.
    #[inline(always)]
    pub fn ends(&self) -> [f32; 2] {
        let (mut low, mut high) = (self.low, self.high);
        for side in [SIDE / 2, SIDE / 4, SIDE / 8] {
            for i in 0..side {
                (low[i], high[i]) = (less(low[i], low[i + side]), more(high[i], high[i + side]));
            }
        }
        [low[0], high[0]]
    }
}

/// As one instruction does it; f32::min asks for what is no number, and takes thrice as long.
#[inline(always)]
fn less(value: f32, least: f32) -> f32 {
    if value < least { value } else { least }
}

/// The greater, as [`less`] finds the lesser.
#[inline(always)]
pub fn more(value: f32, most: f32) -> f32 {
    if value > most { value } else { most }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_are_held_wherever_they_stand() {
        assert_eq!(Extent::NOTHING.ends(), [f32::INFINITY, f32::NEG_INFINITY]);
        for length in 1..40 {
            for at in 0..length {
                let mut values = vec![1.0; length];
                values[at] = -3.0;
                values[(at + 7) % length] += 0.5;
                let mut extent = Extent::NOTHING;
                extent.hold(&values[..length / 3]);
                extent.hold(&values[length / 3..]);
                let want = values.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], &v| [a.min(v), b.max(v)]);
                assert_eq!(extent.ends(), want, "{at} of {length}");
            }
        }
        let mut extent = Extent::NOTHING;
        extent.hold(&[f32::NAN, 2.0, f32::NAN]);
        assert_eq!(extent.ends(), [2.0, 2.0]);
    }
}
