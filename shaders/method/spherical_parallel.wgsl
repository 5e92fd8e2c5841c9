// Spherical billboards, rays parallel to the optical axis; see src/render/method/spherical.rs.
// x, y: offsets on the quad over the radius; own: depth of the centre; inverse: 1/r; front: of the near plane from the centre,
// in radii.
fn footprint(splat: Splat, pixel: Pixel) -> f32 {
    let offset = pixel.at - splat.anchor;
    let a = along(splat.x, offset.x);
    let b = along(splat.y, offset.y);
    return piece(fma(a, a, b * b), splat.front, (pixel.limit - splat.own) * splat.inverse);
}
