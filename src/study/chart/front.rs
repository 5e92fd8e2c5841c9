//! The Pareto front: what no other point beats.

/// Whether each point (time, error) is on the front: no other is as good in both and better in one. Points alike stand or
/// fall together. What is not finite is never on it.
pub fn front(points: &[[f64; 2]]) -> Vec<bool> {
    let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && a != b;
    let finite = |point: &[f64; 2]| point.iter().all(|value| value.is_finite());
    points.iter().map(|point| finite(point) && !points.iter().any(|other| beats(other, point))).collect()
}
