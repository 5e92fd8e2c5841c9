// Optical depth over T0 of the piece of a chord between `front` and `limit`, signed distances over r from its middle; `square` is
// that of the chord's distance from the centre. Umenhoffer et al.: the density at the closest point, all along.
fn piece(square: f32, front: f32, limit: f32) -> f32 {
    let inside = min(square, 1.0);
    let reach = sqrt(1.0 - inside);
    let start = max(front, -reach);
    let end = max(min(limit, reach), start);
    return (1.0 - sqrt(inside)) * (end - start) * 0.5;
}
