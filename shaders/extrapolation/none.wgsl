// The light is that of the slabs.
const FULL: f32 = 1.0;
const HALF: f32 = 0.0;
