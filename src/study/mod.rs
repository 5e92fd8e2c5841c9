//! HOW GOOD: metrics, left-right inconsistency, error surfaces, verification, charts.

pub mod chart;
pub mod error_surface;
pub mod inconsistency;
pub mod metrics;
pub mod plot;
pub mod timing;
pub mod verify;
