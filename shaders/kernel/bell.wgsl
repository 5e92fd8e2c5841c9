// exp(-a q^2): P(u) = exp(-a b^2) times the integral of exp(-a u^2), u times a polynomial of u^2 - 1/2; twins of `Bell` in
// src/render/cpu/primitive.rs (`full`).

fn gaussian_primitive(square: f32, u: f32) -> f32 {
    let w = fma(u, u, -0.5);
    var p = 0.03376358;
    p = fma(p, w, -0.07780638);
    p = fma(p, w, 0.1319628);
    p = fma(p, w, -0.2175916);
    p = fma(p, w, 0.3215717);
    p = fma(p, w, -0.41259372);
    p = fma(p, w, 0.46094787);
    p = fma(p, w, -0.46539173);
    p = fma(p, w, 0.5707922);
    return exp2(-6.492127684 * square) * p * u;
}

fn beliaev_primitive(square: f32, u: f32) -> f32 {
    let w = fma(u, u, -0.5);
    var p = 0.44493905;
    p = fma(p, w, -0.74145794);
    p = fma(p, w, 0.7475231);
    p = fma(p, w, -0.86241466);
    p = fma(p, w, 0.99779695);
    p = fma(p, w, -1.004799);
    p = fma(p, w, 0.90342283);
    p = fma(p, w, -0.73916453);
    p = fma(p, w, 0.5608152);
    p = fma(p, w, -0.42272702);
    p = fma(p, w, 0.44104075);
    return exp2(-11.541560327 * square) * p * u;
}
