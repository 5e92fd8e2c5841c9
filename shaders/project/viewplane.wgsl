// Twin of src/render/method/viewplane.rs.
const VOLUMETRIC: bool = false;

fn measure(body: Body) -> vec2<f32> {
    return body.depth;
}

fn cover(body: Body, eye: Eye) -> Cover {
    return cover_card(body, body.depth.x, eye);
}

fn forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    var splat = card_forms(body, body.depth, eye, pixel);
    splat.own = body.depth.x;
    return splat;
}

fn rim(body: Body, eye: Eye, square: bool) -> Rim {
    if square {
        return no_rim();
    }
    return card_rim(body, body.depth.x, eye);
}
