// Twin of `Slanted` in src/render/method/spherical.rs.
const VOLUMETRIC: bool = true;

fn measure(body: Body) -> vec2<f32> {
    return body.depth;
}

fn cover(body: Body, eye: Eye) -> Cover {
    var covered = cover_body(body, eye);
    if plus2(less2(projection.near, body.depth), body.radius).x > 0.0 {
        covered.front = projection.near.x / body.radius.x;
    }
    return covered;
}

fn forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    var splat = body_forms(body, eye, pixel);
    splat.inverse = 1.0 / body.radius.x;
    return splat;
}

fn rim(body: Body, eye: Eye, square: bool) -> Rim {
    return body_rim(body, eye);
}
