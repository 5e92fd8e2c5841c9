//! A progress bar for work that takes longer than a second, on a terminal only.

use crate::render::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// A bar on stderr; nothing where stderr is no terminal, and nothing in the first second.
pub struct Bar {
    wanted: bool,
    message: &'static str,
    start: Instant,
    bar: OnceLock<ProgressBar>,
}

impl Bar {
    /// A bar with a word for what is being done.
    pub fn new(message: &'static str, quiet: bool) -> Self {
        Self { wanted: !quiet && stderr().is_terminal(), message, start: Instant::now(), bar: OnceLock::new() }
    }
}

impl Progress for Bar {
    fn update(&self, done: u64, total: u64) {
        if self.wanted && self.start.elapsed() > Duration::from_secs(1) {
            let bar = self.bar.get_or_init(|| {
                let style = ProgressStyle::with_template("{msg} {wide_bar} {percent}% {eta}");
                ProgressBar::new(total)
                    .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
                    .with_message(self.message)
            });
            bar.set_length(total);
            bar.set_position(done);
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = self.bar.get() {
            bar.finish_and_clear();
        }
    }
}
