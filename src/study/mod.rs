//! HOW GOOD: metrics, error surfaces, charts.
