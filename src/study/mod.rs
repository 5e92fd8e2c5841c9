//! HOW GOOD: metrics, error surfaces, charts.

pub mod metrics;
