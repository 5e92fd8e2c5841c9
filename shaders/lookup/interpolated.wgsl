// S at a place y and the signed distance t in [-1, 1] from the middle, of the table with `count` segments that begins at an entry:
// interpolated between planes (Beliaev & Zaytseva).
fn values(first: u32, count: f32, y: vec2<f32>, t: f32) -> f32 {
    let at = fma(t, 0.5 * count, 0.5 * count);
    let plane = floor(at);
    let line = first + u32(plane) * LINE;
    let low = line_value(line, y);
    return fma(at - plane, line_value(line + LINE, y) - low, low);
}
