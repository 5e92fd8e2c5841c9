// Pre-integrated segments of kernels; twins of src/render/cpu/segments.rs. `tables` holds a line of S over y for each plane from
// t = -1 to 1.

// Intervals of y, and entries of a line.
const INTERVALS: f32 = 256.0;
const LINE: u32 = 258u;

// The place y for u^2 >= 0: entry of a line, and how far from it to the next; y = 0, where S is 0, beyond the ball.
fn place(square: f32) -> vec2<f32> {
    let half = sqrt(max(1.0 - square, 0.0));
    // A root of 1 may be a hair more.
    let at = (1.0 - sqrt(max(1.0 - half, 0.0))) * INTERVALS;
    let whole = floor(at);
    return vec2<f32>(whole, at - whole);
}

// The value at a place of the line that begins at an entry.
fn line_value(line: u32, y: vec2<f32>) -> f32 {
    let entry = line + u32(y.x);
    let low = tables[entry];
    return fma(y.y, tables[entry + 1u] - low, low);
}
