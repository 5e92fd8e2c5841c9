// Kernels' footprints: twins of src/scene/kernel (f64) and src/render/cpu/footprint.rs (vectors).

// 4.5 log2(e).
const GAUSSIAN_LOG2: f32 = 6.492127684;

// exp(-4.5 v), v >= 0.
fn gaussian(v: f32) -> f32 {
    return exp2(-GAUSSIAN_LOG2 * v);
}

// What a Gaussian billboard shows from the squares of its offsets: the whole open square.
fn gaussian_square(aa: f32, bb: f32) -> f32 {
    return select(0.0, gaussian(aa + bb), max(aa, bb) < 1.0);
}

// F(u) of the Gaussian ball from w = 1 - u^2: sqrt(w) P(w), P minimax on [0, 1] (5.8e-6).
fn gaussian_ball(w: f32) -> f32 {
    let x = max(w, 0.0);
    var p = 0.70262223;
    p = fma(p, x, -1.4590545);
    p = fma(p, x, 1.872605);
    p = fma(p, x, -0.8298228);
    p = fma(p, x, 0.514775);
    p = fma(p, x, 0.088091515);
    p = fma(p, x, 0.084207185);
    p = fma(p, x, 0.026570583);
    return p * sqrt(x);
}

// F(u) from v = u^2 >= 0 by the table of F(u) / sqrt(1 - u^2) from entry `first`, at most `most`; 0 for v >= 1.
fn tabulated(v: f32, first: u32, intervals: f32, most: f32) -> f32 {
    let inside = min(v, 1.0);
    let at = sqrt(inside) * intervals;
    // The table has an entry more than it needs: what rounding leaves beyond the end stays inside.
    let whole = min(floor(at), intervals);
    let entry = first + u32(whole);
    let low = tables[entry];
    return min(sqrt(1.0 - inside) * fma(at - whole, tables[entry + 1u] - low, low), most);
}
