// Densities that are linear on shells, `linear` and `table`; twin of `Shells` in src/render/cpu/primitive.rs. `tables` holds four
// numbers per shell: q at its ends, the density at the first, and its slope.

// D(u) for u >= 0, the integral of q = sqrt(u^2 + b^2).
fn distance_integral(square: f32, u: f32, q: f32) -> f32 {
    // Below this the product with the logarithm is nothing.
    let b2 = max(square, 1e-30);
    let sum = u + q;
    // Rounding may leave u + q a hair below b.
    let arc = max(log2(sum) - 0.5 * log2(b2), 0.0) * 0.6931471805599453;
    return 0.5 * fma(u, q, b2 * arc);
}

fn shells_primitive(square: f32, u: f32, first: u32, count: u32) -> f32 {
    let size = abs(u);
    let whole = distance_integral(square, size, sqrt(fma(size, size, square)));
    var start = 0.0;
    var below = 0.0;
    var sum = 0.0;
    for (var i = first; i < first + count; i++) {
        let q0 = tables[4u * i];
        let q1 = tables[4u * i + 1u];
        let along = sqrt(max(q1 * q1 - square, 0.0));
        // Beneath the shell there is nothing.
        let leg = select(0.0, distance_integral(square, along, q1), square < q1 * q1);
        let end = min(size, along);
        let above = min(whole, leg);
        let length = max(end - start, 0.0);
        // Clamped to what the shell allows, so that a nearly vertical step does not amplify rounding.
        let rise = clamp(fma(-length, q0, above - below), 0.0, length * (q1 - q0));
        sum = fma(length, tables[4u * i + 2u], sum);
        sum = fma(rise, tables[4u * i + 3u], sum);
        start = max(start, end);
        below = max(below, above);
    }
    return sign(u) * sum;
}
