// Twin of src/render/method/perspective.rs.
const VOLUMETRIC: bool = false;

fn measure(body: Body) -> vec2<f32> {
    return distance_squared(body);
}

fn cover(body: Body, eye: Eye) -> Cover {
    var covered = cover_body(body, eye);
    let outside = less2(distance_squared(body), times2(body.radius, body.radius)).x > 0.0;
    if outside && !(less2(body.depth, body.radius).x > 0.0) {
        covered.front = 0.0;
    }
    return covered;
}

fn forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    var splat = body_forms(body, eye, pixel);
    splat.own = body.radius.x;
    return splat;
}

fn rim(body: Body, eye: Eye, square: bool) -> Rim {
    return body_rim(body, eye);
}
