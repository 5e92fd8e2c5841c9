//! Round numbers along an axis: 1, 2 or 5 times a power of ten apart, with short labels.

/// Ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Ticks {
    /// Ascending multiples of [`Ticks::step`] within the axis, each the double nearest to its decimal form; never -0.
    pub values: Vec<f64>,
    /// Their labels, with U+2212 as the minus sign.
    pub labels: Vec<String>,
    /// The distance between two, 1, 2 or 5 times a power of ten.
    pub step: f64,
}

/// Plain decimals of so many characters, without a sign, are short; longer ones may be one character longer than the form
/// 2e-5.
const SHORT: usize = 6;
/// Plain decimals are not even tried for powers of ten beyond this.
const PLAIN: i32 = 12;
/// An axis narrower than this part of its own distance from zero has no ticks that short numbers could tell apart.
const NARROWEST: f64 = 1e-9;

impl Ticks {
    /// The finest ticks from `lo` to `hi`, both included, that are at most `most` (at least 2), `lo < hi`, magnitudes from
    /// 1e-300 to 1e300. An axis too narrow for short numbers has one tick, at its start.
    pub fn new(lo: f64, hi: f64, most: usize) -> Self {
        let width = hi - lo;
        let largest = lo.abs().max(hi.abs());
        if !(width > NARROWEST * largest && width.is_finite()) {
            return Self { values: vec![lo], labels: labels(&[lo], -PLAIN - 1), step: width };
        }
        // From a step that gives too many upwards; the tolerance keeps ends that a rounding has moved.
        let slack = 1e-9 * width;
        let mut exponent = (width / most.max(2) as f64).log10().floor() as i32 - 1;
        loop {
            for mantissa in [1_i64, 2, 5] {
                let step = decimal(mantissa, exponent);
                let first = ((lo - slack) / step).ceil() as i64;
                let last = ((hi + slack) / step).floor() as i64;
                if last - first < most.max(2) as i64 {
                    return Self::multiples(first, last, mantissa, exponent);
                }
            }
            exponent += 1;
        }
    }

    /// The finest ticks whose labels do not collide: along `length` pixels, a label needs `extent(label)` of them.
    pub fn along(lo: f64, hi: f64, length: f64, extent: impl Fn(&str) -> f64) -> Self {
        let mut most = 9;
        loop {
            let ticks = Self::new(lo, hi, most);
            let needed = ticks.labels.iter().map(|label| extent(label)).fold(0.0, f64::max);
            if most == 2 || ticks.step / (hi - lo) * length >= needed {
                return ticks;
            }
            most -= 1;
        }
    }

    fn multiples(first: i64, last: i64, mantissa: i64, exponent: i32) -> Self {
        let step = decimal(mantissa, exponent);
        let values: Vec<f64> = (first..=last).map(|n| decimal(n * mantissa, exponent)).collect();
        let labels = labels(&values, exponent);
        Self { values, labels, step }
    }

    /// The `count` round numbers below [`Ticks::step`], the largest first, with their labels.
    pub fn finer(&self, count: usize) -> Vec<(f64, String)> {
        let mut exponent = self.step.log10().floor() as i32 + 1;
        let mut found = Vec::new();
        while found.len() < count && exponent > -300 {
            for mantissa in [5, 2, 1] {
                let value = decimal(mantissa, exponent);
                if value < self.step * (1.0 - NARROWEST) && found.len() < count {
                    found.push((value, labels(&[value], exponent).concat()));
                }
            }
            exponent -= 1;
        }
        found
    }
}

/// Labels of multiples of 10^`exponent`, all in one form.
fn labels(values: &[f64], exponent: i32) -> Vec<String> {
    let label = |form: &dyn Fn(f64) -> String| -> Vec<String> {
        values.iter().map(|&v| if v == 0.0 { "0".to_owned() } else { form(v).replace('-', "\u{2212}") }).collect()
    };
    let unsigned = |label: &String| label.chars().filter(char::is_ascii).count();
    let longest = |labels: &[String]| labels.iter().map(unsigned).max().unwrap_or(0);
    let short = label(&|v| format!("{v:e}"));
    if exponent.abs() > PLAIN {
        return short;
    }
    let decimals = exponent.min(0).unsigned_abs() as usize;
    let plain = label(&|v| format!("{v:.decimals$}"));
    if longest(&plain) > SHORT.max(longest(&short) + 1) { short } else { plain }
}

/// `mantissa` 10^`exponent`, correctly rounded.
fn decimal(mantissa: i64, exponent: i32) -> f64 {
    format!("{mantissa}e{exponent}").parse().unwrap_or(0.0)
}
