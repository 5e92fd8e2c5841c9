// Twins of `Constant` and `Poly` in src/render/cpu/primitive.rs.

// 1: P(u) = u.
fn constant_primitive(u: f32) -> f32 {
    return u;
}

// (1 - q^2)^2: P(u) = u [L^4 - 2 L^2 u^2/3 + u^4/5], L^2 = 1 - b^2.
fn poly_primitive(square: f32, u: f32) -> f32 {
    let half2 = 1.0 - square;
    let u2 = u * u;
    return u * fma(fma(u2, 0.2, half2 * -0.6666667), u2, half2 * half2);
}
