// The light is that of the slabs.
const FULL: f32 = 1.0;
const HALF: f32 = 0.0;
// The estimate of what it is off, from the light of the slabs, of half and of a quarter as many: (L_K - L_K/2) / 3.
const OFF: vec3<f32> = vec3<f32>(0.33333334, -0.33333334, 0.0);
