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

/// Plain decimals are used up to this magnitude and down to steps of a thousandth, the form 2e-5 beyond.
const PLAIN: f64 = 1e5;
/// An axis narrower than this part of its own distance from zero has no ticks that short numbers could tell apart.
const NARROWEST: f64 = 1e-9;

impl Ticks {
    /// The finest ticks from `lo` to `hi`, both included, that are at most `most` (at least 2), `lo < hi`, magnitudes from
    /// 1e-300 to 1e300. An axis too narrow for short numbers has one tick, at its start.
    pub fn new(lo: f64, hi: f64, most: usize) -> Self {
        let width = hi - lo;
        let largest = lo.abs().max(hi.abs());
        if !(width > NARROWEST * largest && width.is_finite()) {
            return Self { values: vec![lo], labels: vec![minus(&format!("{lo:e}"))], step: width };
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
        let plain = exponent >= -3 && values.iter().all(|v| v.abs() < PLAIN);
        let decimals = exponent.min(0).unsigned_abs() as usize;
        let label = |&v: &f64| match v {
            0.0 => "0".to_owned(),
            _ if plain => minus(&format!("{v:.decimals$}")),
            _ => minus(&format!("{v:e}")),
        };
        let labels = values.iter().map(label).collect();
        Self { values, labels, step }
    }
}

/// `mantissa` 10^`exponent`, correctly rounded.
fn decimal(mantissa: i64, exponent: i32) -> f64 {
    format!("{mantissa}e{exponent}").parse().unwrap_or(0.0)
}

fn minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}
