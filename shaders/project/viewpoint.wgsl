// Twin of src/render/method/viewpoint.rs.
const VOLUMETRIC: bool = false;

fn measure(body: Body) -> vec2<f32> {
    return distance_squared(body);
}

// The intervals of tangents grow with a corner of the card: at u and v, of eye space with depth instead of z.
fn with_corner(center: vec3<f32>, corner: vec3<f32>, x: ptr<function, vec2<f32>>, y: ptr<function, vec2<f32>>) {
    let at = corner.xy / corner.z;
    let slack = 1e-6 * (length(center) + distance(center, corner)) / corner.z * (1.0 + abs(at));
    *x = vec2<f32>(min((*x).x, at.x - slack.x), max((*x).y, at.x + slack.x));
    *y = vec2<f32>(min((*y).x, at.y - slack.y), max((*y).y, at.y + slack.y));
}

fn cover(body: Body, eye: Eye) -> Cover {
    let c = vec3<f32>(body.x.x, body.y.x, body.depth.x);
    let aside = length(c.xz);
    let away = length(c);
    let u = vec3<f32>(c.z, 0.0, -c.x) / aside * body.radius.x;
    let v = vec3<f32>(-c.y * c.x, aside * aside, -c.y * c.z) / (away * aside) * body.radius.x;
    let nearest = c.z - abs(u.z) - abs(v.z);
    // A card that reaches behind the eye may cover any pixel, and its plane may be met behind the eye.
    if !(nearest >= 1e-3 * c.z) {
        let size = vec2<f32>(projection.size);
        return Cover(vec2<f32>(0.0, size.x), vec2<f32>(0.0, size.y), 0.0);
    }
    var x = vec2<f32>(FARTHEST, -FARTHEST);
    var y = vec2<f32>(FARTHEST, -FARTHEST);
    with_corner(c, c - u - v, &x, &y);
    with_corner(c, c - u + v, &x, &y);
    with_corner(c, c + u - v, &x, &y);
    with_corner(c, c + u + v, &x, &y);
    let none = vec2<f32>(0.0);
    return Cover(across_picture(eye, x, none), down_picture(eye, y, none), -FARTHEST);
}

fn forms(body: Body, eye: Eye, pixel: vec2<u32>) -> Splat {
    let c = vec3<f32>(body.x.x, body.y.x, body.depth.x);
    let meeting = meet(body, body.depth, eye, pixel);
    let aside = length(c.xz);
    let away = length(c);
    var splat = Splat();
    // |C|^2 (dir . u)/r, with u = (d, 0, C_x)/s in eye space, s^2 = d^2 + C_x^2.
    let a = away * away / aside;
    splat.x = vec2<f32>(-meeting.cross.x * a, c.z / body.radius.x * a * meeting.step.x);
    // |C|^2 (dir . v)/r, with v = (-C_x C_y, s^2, C_y d)/(|C| s): of s^2 Y - C_y (C_x X + d) nothing cancels as
    // d (d Y - C_y) + C_x (C_x Y - C_y X).
    let b = away / aside;
    splat.both = vec3<f32>(
        b * (c.z * meeting.cross.y + c.x * meeting.cross.z),
        -b * c.x * c.y / body.radius.x * meeting.step.x,
        b * aside * aside / body.radius.x * meeting.step.y,
    );
    splat.ahead = vec3<f32>(meeting.ahead, c.x * meeting.step.x, c.y * meeting.step.y);
    splat.own = distance_squared(body).x;
    return splat;
}

fn rim(body: Body, eye: Eye, square: bool) -> Rim {
    if square {
        return no_rim();
    }
    return facing_rim(body, eye);
}
