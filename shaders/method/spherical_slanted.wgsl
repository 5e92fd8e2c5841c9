// Spherical billboards, rays through the eye; see src/render/method/spherical.rs.
// x, y, both: the components of c x dir over the radius; ahead: c . dir over the radius; inverse: 1/r; front: depth of the near
// plane in radii.
fn footprint(splat: Splat, pixel: Pixel) -> f32 {
    let offset = pixel.at - splat.anchor;
    let u = vec3<f32>(along(splat.x, offset.x), along(splat.y, offset.y), across(splat.both, offset));
    let per_length = sqrt(pixel.weight);
    let closest = across(splat.ahead, offset) * per_length;
    return piece(dot(u, u) * pixel.weight, splat.front / per_length - closest, pixel.limit * splat.inverse - closest);
}
