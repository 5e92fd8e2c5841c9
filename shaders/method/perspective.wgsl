// The exact projection of each ball; see src/render/method/perspective.rs.
// x, y, both: the components of c x dir over the radius; ahead: c . dir over the radius; own: the radius.
fn footprint(splat: Splat, pixel: Pixel) -> f32 {
    let offset = pixel.at - splat.anchor;
    let u = vec3<f32>(along(splat.x, offset.x), along(splat.y, offset.y), across(splat.both, offset));
    let square = dot(u, u) * pixel.weight;
    let ahead = across(splat.ahead, offset);
    if !(splat.front < ahead && ahead * splat.own < pixel.limit) {
        return 0.0;
    }
    if splat.intervals == 0.0 {
        return gaussian_ball(1.0 - square);
    }
    return tabulated(square, splat.table, splat.intervals, splat.most);
}
