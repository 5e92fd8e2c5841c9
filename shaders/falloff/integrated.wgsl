// G(u) = u - [u sqrt(u^2 + b^2) + b^2 asinh(u/b)]/2 from b^2 > 0.
fn primitive(square: f32, u: f32) -> f32 {
    let size = abs(u);
    let far = sqrt(fma(u, u, square));
    // asinh is odd; for u < 0 its logarithm would cancel.
    let arc = (log2(size + far) - 0.5 * log2(square)) * 0.6931471805599453;
    return sign(u) * (size - 0.5 * fma(size, far, square * arc));
}

// Optical depth over T0 of the piece of a chord between `front` and `limit`, signed distances over r from its middle; `square` is
// that of the chord's distance from the centre. The linear falloff, integrated.
fn piece(square: f32, front: f32, limit: f32) -> f32 {
    let inside = min(square, 1.0);
    let reach = sqrt(1.0 - inside);
    let start = max(front, -reach);
    let end = max(min(limit, reach), start);
    // Below this the product with the logarithm is nothing.
    let b2 = max(inside, 1e-30);
    return primitive(b2, end) - primitive(b2, start);
}
