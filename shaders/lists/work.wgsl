// What a kernel of the lists is told. See src/render/gpu/steps.rs.
struct Work {
    // Elements, or those that stand for all views that share their order.
    count: u32,
    // Lowest bit of the digit.
    shift: u32,
    // Blocks of 1024 elements.
    blocks: u32,
    // Particles of the scene: element v * particles + i is particle i as view v sees it.
    particles: u32,
    // Keys of tiles from view to view.
    stride: u32,
    // Tiles in a row of tiles.
    across: u32,
    // Views that share the order.
    together: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
