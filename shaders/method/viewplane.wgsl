// Billboards parallel to the view plane; see src/render/method/viewplane.rs.
// x, y: offsets over the radius; own: depth of the centre.
fn footprint(splat: Splat, pixel: Pixel) -> f32 {
    let offset = pixel.at - splat.anchor;
    let a = along(splat.x, offset.x);
    let b = along(splat.y, offset.y);
    if !(splat.own < pixel.limit) {
        return 0.0;
    }
    if splat.intervals == 0.0 {
        return gaussian_square(a * a, b * b);
    }
    return tabulated(fma(a, a, b * b), splat.table, splat.intervals, splat.most);
}
