// 1 - 2^-x, x >= 0: the opacity of an optical depth in powers of two. For thin gas by its series, since the difference from 1
// would lose its digits.
fn opacity(x: f32) -> f32 {
    let t = x * 0.6931471805599453;
    let series = t * fma(t, fma(t, fma(t, fma(t, fma(t, -0.001388888888888889, 0.008333333333333333), -0.041666666666666664), 0.16666666666666666), -0.5), 1.0);
    return select(1.0 - exp2(-x), series, t < 0.25);
}
