// Billboards that face their own eye; see src/render/method/viewpoint.rs.
// x: |C|^2 (dir . u)/r; both: |C|^2 (dir . v)/r; ahead: C . dir; own: |C|^2.
fn footprint(splat: Splat, pixel: Pixel) -> f32 {
    let offset = pixel.at - splat.anchor;
    let ahead = across(splat.ahead, offset);
    let inverse = 1.0 / ahead;
    let a = along(splat.x, offset.x) * inverse;
    let b = across(splat.both, offset) * inverse;
    if !(splat.front < ahead && splat.own * inverse < pixel.limit) {
        return 0.0;
    }
    if splat.intervals == 0.0 {
        return gaussian_square(a * a, b * b);
    }
    return tabulated(fma(a, a, b * b), splat.table, splat.intervals, splat.most);
}
