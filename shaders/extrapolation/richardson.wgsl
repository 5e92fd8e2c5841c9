// The light is extrapolated from that of the slabs and of half as many: (4 L_K - L_K/2) / 3.
const FULL: f32 = 1.3333334;
const HALF: f32 = -0.33333334;
// The estimate of what it is off, from the light of the slabs, of half and of a quarter as many: a fifteenth of the difference of the
// extrapolations from K and from K/2, (4 L_K - 5 L_K/2 + L_K/4) / 45.
const OFF: vec3<f32> = vec3<f32>(0.08888889, -0.11111111, 0.022222223);
