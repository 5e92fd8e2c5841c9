// S at a place y and the signed distance t in [-1, 1] from the middle, of the table with `count` segments that begins at an entry:
// at the nearest plane (Mueller & Crawfis).
fn values(first: u32, count: f32, y: vec2<f32>, t: f32) -> f32 {
    return line_value(first + u32(round(fma(t, 0.5 * count, 0.5 * count))) * LINE, y);
}
