//! Text in SVG: escaped, with lowered indices, and how wide it is at most.

use std::fmt::Write;

/// The characters that XML gives a meaning are spelt out; those that it forbids are replaced by U+FFFD.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' | '\r' => out.push(' '),
            // XML 1.0, production [2].
            c if c < ' ' || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// The content of a `text` element: [`escape`]d; what follows a single letter and `_`, as in `C_x`, is lowered.
pub fn markup(text: &str, size: f64) -> String {
    let mut out = String::new();
    // An index is drawn at 0.8 of the size, a fifth of it lower; the step is taken back by what comes next.
    let (small, drop) = ((size * 0.8 * 10.0).round() / 10.0, (size * 0.2 * 10.0).round() / 10.0);
    let mut lowered = false;
    for (part, index) in parts(text) {
        if index {
            let _ = write!(out, "<tspan dy=\"{drop}\" font-size=\"{small}\">{}</tspan>", escape(part));
        } else if lowered {
            let _ = write!(out, "<tspan dy=\"-{drop}\">{}</tspan>", escape(part));
        } else {
            out.push_str(&escape(part));
        }
        lowered = index;
    }
    out
}

/// The text in pieces, those that are indices marked, without their `_`.
fn parts(text: &str) -> Vec<(&str, bool)> {
    let mut parts = Vec::new();
    let mut rest = text;
    let mut from = 0;
    while let Some(at) = rest[from..].find('_').map(|at| at + from) {
        let mut before = rest[..at].chars().rev();
        let letter =
            before.next().is_some_and(char::is_alphabetic) && !before.next().is_some_and(char::is_alphanumeric);
        let index: usize = rest[at + 1..].chars().take_while(|c| c.is_alphanumeric()).map(char::len_utf8).sum();
        if letter && index > 0 {
            parts.push((&rest[..at], false));
            parts.push((&rest[at + 1..at + 1 + index], true));
            rest = &rest[at + 1 + index..];
            from = 0;
        } else {
            from = at + 1;
        }
    }
    if !rest.is_empty() {
        parts.push((rest, false));
    }
    parts
}

/// Width in pixels, from above for figures and the usual letters in the usual sans-serif fonts: a figure takes 0.64 of the
/// size in DejaVu Sans and Verdana, the widest of them, and 0.56 in Arial.
pub fn width(text: &str, size: f64) -> f64 {
    0.64 * size * text.chars().count() as f64
}
