//! HOW GOOD: metrics, left-right inconsistency, error surfaces, charts.

pub mod error_surface;
pub mod inconsistency;
pub mod metrics;
pub mod plot;
