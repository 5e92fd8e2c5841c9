// The light is extrapolated from that of the slabs and of half as many: (4 L_K - L_K/2) / 3.
const FULL: f32 = 1.3333334;
const HALF: f32 = -0.33333334;
