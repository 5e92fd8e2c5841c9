// The linear model: what is given is the opacity.
fn opacity(x: f32) -> f32 {
    return x;
}
