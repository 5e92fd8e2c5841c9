//! Measures the machine's f32 arithmetic peak, level by level: independent chains of multiply-add in registers, nothing
//! loaded or stored, on one thread and on all of them. It is what the renderer's own arithmetic is compared with.
//!
//! ```text
//! cargo run --release --example peak [-- THREADS]
//! ```
//!
//! Prints one JSON object. `gflops` is the fastest of several short runs, the number to call a peak; `gflops_median`
//! tells how disturbed they were. A level without fused multiply-add does it in two instructions and still counts two
//! operations. Enough chains hide the latency and too many spill, so several numbers of chains are tried.

use serde_json::json;
use std::hint::black_box;
use std::sync::Barrier;
use std::time::Instant;
use stereomist::render::cpu::simd::{Level, Simd, WithSimd, dispatch};

/// Multiply-adds per chain in a run: a millisecond or two, short enough to find a moment in which nothing else runs.
const STEPS: u64 = 1 << 19;

/// Runs per measurement.
const RUNS: usize = 51;

/// `N` chains x -> x a + b, `steps` long.
struct Chains<const N: usize> {
    steps: u64,
}

/// What a job tells about itself: lanes of a vector, and the sum of its chains, so that they have to be computed.
struct Done {
    lanes: usize,
    sum: f32,
}

impl<const N: usize> WithSimd for Chains<N> {
    type Output = Done;

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) -> Done {
        // The chains converge to b / (1 - a) = 1: no infinities, no denormal numbers.
        let (a, b) = (s.splat(black_box(0.75)), s.splat(black_box(0.25)));
        let mut x = [s.splat(0.0); N];
        for (i, x) in x.iter_mut().enumerate() {
            *x = s.splat(i as f32);
        }
        for _ in 0..self.steps {
            for x in &mut x {
                *x = s.mul_add(*x, a, b);
            }
        }
        let mut sum = s.splat(0.0);
        for x in x {
            sum = s.add(sum, x);
        }
        Done { lanes: S::LANES, sum: s.reduce_max(sum) }
    }
}

/// One measured number of chains.
struct Peak {
    chains: usize,
    lanes: usize,
    best: f64,
    median: f64,
}

/// GFLOP/s of `N` chains on each of `threads` threads. All start a run together; their rates are added up.
fn measure<const N: usize>(level: Level, threads: usize) -> Peak {
    let barrier = Barrier::new(threads);
    let work = || {
        let mut lanes = 0;
        let rates: Vec<f64> = (0..RUNS)
            .map(|_| {
                barrier.wait();
                let start = Instant::now();
                let done = dispatch(level, Chains::<N> { steps: STEPS });
                let time = start.elapsed();
                black_box(done.sum);
                lanes = done.lanes;
                (2 * N * lanes) as f64 * STEPS as f64 / time.as_secs_f64() / 1e9
            })
            .collect();
        (lanes, rates)
    };
    let done: Vec<(usize, Vec<f64>)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().map(|worker| worker.join().expect("a worker does not panic")).collect()
    });
    let mut rates: Vec<f64> = (0..RUNS).map(|run| done.iter().map(|(_, rates)| rates[run]).sum()).collect();
    rates.sort_unstable_by(f64::total_cmp);
    Peak { chains: N, lanes: done[0].0, best: rates[RUNS - 1], median: rates[RUNS / 2] }
}

/// The best number of chains.
fn peak(level: Level, threads: usize) -> Peak {
    let tried = [
        measure::<8>(level, threads),
        measure::<12>(level, threads),
        measure::<14>(level, threads),
        measure::<16>(level, threads),
        measure::<24>(level, threads),
    ];
    tried.into_iter().max_by(|a, b| a.best.total_cmp(&b.best)).expect("several are tried")
}

fn main() {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = match std::env::args().nth(1).map(|text| text.parse::<usize>()) {
        None => cores,
        Some(Ok(threads)) if threads > 0 => threads,
        Some(_) => {
            eprintln!("usage: peak [THREADS]");
            std::process::exit(2);
        }
    };
    let levels: Vec<_> = Level::available()
        .into_iter()
        .map(|level| {
            let (one, all) = (peak(level, 1), peak(level, threads));
            json!({
                "level": level.name(),
                "lanes": all.lanes,
                "gflops": all.best,
                "gflops_median": all.median,
                "chains": all.chains,
                "gflops_one_thread": one.best,
            })
        })
        .collect();
    println!("{}", json!({ "threads": threads, "levels": levels }));
}
