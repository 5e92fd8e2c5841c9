// What the tile shaders read and write, beside the particles.
@group(0) @binding(0) var<uniform> view: View;
// Tile by tile: where its particles begin in `list`, one entry more than there are tiles; for slabs and slices, group by group.
@group(0) @binding(2) var<storage, read> starts: array<u32>;
// The particles of each tile.
@group(0) @binding(3) var<storage, read> list: array<u32>;
@group(0) @binding(4) var<storage, read> tables: array<f32>;
// Per pixel: colour of what is behind the gas and its depth in the method's measure.
@group(0) @binding(5) var<storage, read> surfaces: array<vec4<f32>>;
// Per pixel: colour and transmittance; between batches of the gas alone.
@group(0) @binding(6) var<storage, read_write> film: array<vec4<f32>>;
// Tiles that went through their lists, and particles composited, both summed over batches.
@group(0) @binding(7) var<storage, read_write> tally: array<atomic<u32>, 2>;
