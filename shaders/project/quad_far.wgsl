// Depth of the quad: at the ball's farthest point.
fn quad(body: Body) -> vec2<f32> {
    return plus2(body.depth, body.radius);
}
