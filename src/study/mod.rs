//! HOW GOOD: metrics, error surfaces, charts.

pub mod error_surface;
pub mod metrics;
pub mod plot;
