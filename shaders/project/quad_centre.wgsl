// Depth of the quad: the centre's, or the near plane's where that is farther.
fn quad(body: Body) -> vec2<f32> {
    return select(projection.near, body.depth, less2(body.depth, projection.near).x > 0.0);
}
