//! Progress of work that takes longer than a second, on a terminal only.

use crate::render::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, stderr};
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A bar on stderr; nothing where stderr is no terminal, and nothing in the first second.
pub struct Bar {
    wanted: bool,
    message: &'static str,
    start: Instant,
    bar: OnceLock<ProgressBar>,
}

/// Length of the bar.
const STEPS: u64 = 1000;

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
                ProgressBar::new(STEPS)
                    .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
                    .with_message(self.message)
            });
            // Steps of its own: the total may change between updates, the bar's length may not.
            bar.set_position(
                u64::try_from(u128::from(done) * u128::from(STEPS) / u128::from(total.max(1))).unwrap_or(STEPS),
            );
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

/// A sign of life while work goes on whose end cannot be told; nothing where stderr is no terminal, and nothing in the
/// first second.
pub struct Waiting(Option<(Sender<()>, JoinHandle<()>)>);

impl Waiting {
    /// Starts to wait, with a word for what is being done.
    pub fn new(message: &'static str, quiet: bool) -> Self {
        Self((!quiet && stderr().is_terminal()).then(|| {
            let (done, is_done) = channel();
            let thread = std::thread::spawn(move || {
                if is_done.recv_timeout(Duration::from_secs(1)) == Err(RecvTimeoutError::Timeout) {
                    let bar = ProgressBar::new_spinner().with_message(message).with_elapsed(Duration::from_secs(1));
                    if let Ok(style) = ProgressStyle::with_template("{msg} {elapsed}") {
                        bar.set_style(style);
                    }
                    bar.enable_steady_tick(Duration::from_secs(1));
                    // An error is the end too: it is what dropping the sender gives.
                    let _ = is_done.recv();
                    bar.finish_and_clear();
                }
            });
            (done, thread)
        }))
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        if let Some((done, thread)) = self.0.take() {
            drop(done);
            // The line must be clear before anything else is printed; a thread that panicked has nothing to clear.
            let _ = thread.join();
        }
    }
}
