//! Logarithmic axes: powers of ten and what lies between.

/// A logarithmic axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decades {
    /// Decimal logarithms of its ends.
    ends: [f64; 2],
}

/// By how much a short axis grows at either end, in decades.
const STEP: f64 = 0.04;
/// Most powers of ten between which there is room for more labels.
const FEW: usize = 3;
/// What is left free beyond the outermost values, in decades.
const MARGIN: f64 = 0.12;

impl Decades {
    /// An axis that holds these values, all above 0 and finite, with a margin, a power of ten and at least two
    /// labels. Without values it is from 0.1 to 10.
    pub fn new(values: impl IntoIterator<Item = f64>) -> Self {
        let logs = values.into_iter().map(f64::log10);
        let found = logs.fold(None, |ends: Option<[f64; 2]>, log| {
            Some(ends.map_or([log; 2], |[lo, hi]| [lo.min(log), hi.max(log)]))
        });
        let ends = found.map_or([-1.0, 1.0], |[lo, hi]| [lo - MARGIN, hi + MARGIN]);
        let mut axis = Self { ends };
        // Two labels tell what an axis is, and one of them is to be a power of ten.
        while axis.exponents()[0] > axis.exponents()[1] || axis.labels(2).len() < 2 {
            axis.ends = [axis.ends[0] - STEP, axis.ends[1] + STEP];
        }
        axis
    }

    /// Where a value above 0 stands: 0 at the lower end, 1 at the upper one.
    pub fn part(&self, value: f64) -> f64 {
        let [lo, hi] = self.ends;
        (value.log10() - lo) / (hi - lo)
    }

    /// What gets a label, with it: the powers of ten on the axis, and 2 and 5 times them on an axis of no more than
    /// [`FEW`]; where there are more than `most` powers (at least 2), every second, third ... of them.
    pub fn labels(&self, most: usize) -> Vec<(f64, String)> {
        let [first, last] = self.exponents();
        let count = (last - first + 1).max(1) as usize;
        if count <= FEW {
            let all = (first - 1..=last).flat_map(|exponent| [1, 2, 5].map(|digit| (digit, exponent)));
            let on_axis = all.filter(|&(digit, exponent)| self.holds(times(digit, exponent)));
            return on_axis.map(|(digit, exponent)| (times(digit, exponent), label(digit, exponent))).collect();
        }
        let step = count.div_ceil(most.max(2));
        (first..=last).step_by(step).map(|exponent| (times(1, exponent), label(1, exponent))).collect()
    }

    /// Powers of ten and, on an axis of no more than `most` of them, 2 to 9 times them.
    pub fn lines(&self, most: usize) -> Vec<(f64, bool)> {
        let [first, last] = self.exponents();
        let fine = last - first < most as i32;
        let all = (first - 1..=last).flat_map(|exponent| {
            let digits = if fine { 1..=9 } else { 1..=1 };
            digits.map(move |digit: i32| (times(digit, exponent), digit == 1))
        });
        all.filter(|(value, _)| self.holds(*value)).collect()
    }

    fn holds(&self, value: f64) -> bool {
        (0.0..=1.0).contains(&self.part(value))
    }

    fn exponents(&self) -> [i32; 2] {
        [self.ends[0].ceil() as i32, self.ends[1].floor() as i32]
    }
}

/// `digit` 10^`exponent`, correctly rounded.
fn times(digit: i32, exponent: i32) -> f64 {
    format!("{digit}e{exponent}").parse().unwrap_or(0.0)
}

/// Plain from a thousandth to hundreds of thousands.
fn label(digit: i32, exponent: i32) -> String {
    if (-3..=5).contains(&exponent) {
        times(digit, exponent).to_string()
    } else {
        format!("{digit}e{exponent}").replace('-', "\u{2212}")
    }
}
