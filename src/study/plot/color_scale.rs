//! Values to colours, and the bar that explains them.

use colorous::Gradient;

use super::canvas::{Anchor, Canvas, Color, INK, Stroke, Text};
use super::range::Range;
use super::text;
use super::ticks::Ticks;

/// Blue below 0, white at 0, red above (ColorBrewer RdBu, which colour-blind readers can tell apart); the darkest ends are
/// left out, so that lines over them can be seen.
const SIGNED: (Gradient, f64, f64) = (colorous::RED_BLUE, 0.92, 0.08);
/// Pale yellow where the magnitude is least, over green to dark blue (ColorBrewer YlGnBu); its ends are left out too.
const ONE_SIGN: (Gradient, f64, f64) = (colorous::YELLOW_GREEN_BLUE, 0.04, 0.82);

/// Purple over orange to pale yellow ("inferno"). The darkest end is left out: black stands for something else.
const GLOW: (Gradient, f64, f64) = (colorous::INFERNO, 0.15, 1.0);

/// Where the colours of a range come from.
#[derive(Clone, Copy, Debug)]
enum Palette {
    /// For plots on white paper: diverging where both signs are shown, else the darker the larger.
    Paper,
    /// For pictures: the brighter the larger.
    Glow,
}

/// The colours of a range of values.
#[derive(Clone, Copy, Debug)]
pub struct ColorScale {
    /// What is shown.
    pub range: Range,
    palette: Palette,
}

impl ColorScale {
    /// A diverging scale, 0 in its middle, where both signs are shown, else a sequential one.
    pub fn new(range: Range) -> Self {
        Self { range, palette: Palette::Paper }
    }

    /// The scale of differences above 0 up to `top` > 0: dark purple for the smallest, pale yellow for the largest.
    pub fn glow(top: f64) -> Self {
        Self { range: Range { lo: 0.0, hi: top, below: false, above: false }, palette: Palette::Glow }
    }

    /// The colour of a value; beyond the range that of its end.
    pub fn color(&self, value: f64) -> Color {
        let Range { lo, hi, .. } = self.range;
        let t = self.range.part(value).clamp(0.0, 1.0);
        let ((gradient, from, to), t) = match self.palette {
            Palette::Glow => (GLOW, t),
            Palette::Paper if self.range.signed() => {
                let value = value.clamp(lo, hi);
                (SIGNED, 0.5 + 0.5 * (value / hi.max(-lo)))
            }
            Palette::Paper if hi <= 0.0 => (ONE_SIGN, 1.0 - t),
            Palette::Paper => (ONE_SIGN, t),
        };
        gradient.eval_continuous(from + (to - from) * t).into_array()
    }

    /// The colour at a part of the range, 0 at its low end, 1 at its high end.
    pub fn color_at(&self, part: f64) -> Color {
        self.color(self.range.lo + part * (self.range.hi - self.range.lo))
    }

    /// A bar with ticks and label in the area left, top, width, height; the numbers stand to its right. A triangle marks an
    /// end that stands for values beyond it.
    pub fn bar(&self, canvas: &mut Canvas, area: [f64; 4], ticks: &Ticks, label: &str) {
        let [x, y, w, h] = area;
        let stops: Vec<Color> = (0..=32).map(|i| self.color_at(f64::from(i) / 32.0)).collect();
        canvas.gradient(area, &stops);
        canvas.frame(area);
        let size = 13.0;
        for (&value, tick) in ticks.values.iter().zip(&ticks.labels) {
            let at = y + h * (1.0 - self.range.part(value));
            canvas.line([x + w, at], [x + w + 5.0, at], Stroke::new(INK, 1.0));
            canvas.text(&Text { at: [x + w + 9.0, at + 0.35 * size], size, ..Text::default() }, tick);
        }
        for (beyond, end, away, part) in [(self.range.above, y, -1.0, 1.0), (self.range.below, y + h, 1.0, 0.0)] {
            if beyond {
                let (base, tip) = (end + 3.0 * away, end + 15.0 * away);
                let corners = [[x, base], [x + w, base], [x + w / 2.0, tip]];
                canvas.polygon(&corners, self.color_at(part));
                canvas.lines([&[corners[0], corners[1], corners[2], corners[0]][..]], Stroke::new(INK, 1.0));
                let at = [x + w + 9.0, tip + 0.35 * size];
                canvas.text(&Text { at, size, ..Text::default() }, "beyond");
            }
        }
        let beyond = (self.range.above || self.range.below).then_some("beyond");
        let labels = ticks.labels.iter().map(String::as_str).chain(beyond);
        let widest = labels.map(|label| text::width(label, size)).fold(0.0, f64::max);
        let at = [x + w + 9.0 + widest + 24.0, y + h / 2.0];
        canvas.text(&Text { at, size: 15.0, anchor: Anchor::Middle, turn_deg: -90.0, ..Text::default() }, label);
    }
}
