// Twin of `Parallel` in src/render/method/spherical.rs.
const VOLUMETRIC: bool = true;

fn measure(body: Body) -> vec2<f32> {
    return body.depth;
}

fn cover(body: Body, eye: Eye) -> Cover {
    var covered = cover_card(body, quad(body).x, eye);
    let front = less2(projection.near, body.depth);
    if plus2(front, body.radius).x > 0.0 {
        covered.front = front.x / body.radius.x;
    }
    return covered;
}

fn forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    var splat = card_forms(body, quad(body), eye, pixel);
    splat.own = body.depth.x;
    splat.inverse = 1.0 / body.radius.x;
    return splat;
}

fn rim(body: Body, eye: Eye, square: bool) -> Rim {
    return card_rim(body, quad(body).x, eye);
}
