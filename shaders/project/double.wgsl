// Numbers as sums of two of single precision, 48 bits together, high part first (Dekker 1971; Joldes, Muller & Popescu 2017): where
// single precision would lose what a difference is about.

// The value itself. Compilers may reorder sums of floats, but not through this: they do not know that `nothing` is 0.
fn exactly(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ projection.nothing);
}

// a + b where |a| >= |b| or a = 0.
fn sum_of_ordered(a: f32, b: f32) -> vec2<f32> {
    let sum = exactly(a + b);
    return vec2<f32>(sum, b - exactly(sum - a));
}

fn sum_of(a: f32, b: f32) -> vec2<f32> {
    let sum = exactly(a + b);
    let share = exactly(sum - a);
    return vec2<f32>(sum, exactly(a - exactly(sum - share)) + exactly(b - share));
}

// By halves of 12 bits, whose products are exact, so that it does not matter where they are fused with sums.
fn product_of(a: f32, b: f32) -> vec2<f32> {
    let a_high = bitcast<f32>(bitcast<u32>(a) & 0xfffff000u);
    let b_high = bitcast<f32>(bitcast<u32>(b) & 0xfffff000u);
    let a_low = exactly(a - a_high);
    let b_low = exactly(b - b_high);
    let product = exactly(a * b);
    let rest = exactly(exactly(exactly(a_high * b_high - product) + a_high * b_low) + a_low * b_high);
    return vec2<f32>(product, exactly(rest + a_low * b_low));
}

fn plus2(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let high = sum_of(a.x, b.x);
    let low = sum_of(a.y, b.y);
    let more = sum_of_ordered(high.x, exactly(high.y + low.x));
    return sum_of_ordered(more.x, exactly(low.y + more.y));
}

fn times2(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let product = product_of(a.x, b.x);
    return sum_of_ordered(product.x, exactly(product.y + exactly(a.x * b.y + a.y * b.x)));
}
