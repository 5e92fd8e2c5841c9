//! How much a file may become: tiles of a few bytes stand for up to 4096^3 voxels.

use super::super::columns::ReadError;
use super::bytes::Input;
use super::tree::{Census, LEAF, LOWER, UPPER};

/// The most particles that a volume may become: 3.2 GB of coordinates and values.
pub const MAX_PARTICLES: u64 = 100_000_000;
/// Memory that tiles may need for each byte of the file, and besides: with leaves under way, the whole stays below 64 MB.
const BYTES_PER_BYTE: u64 = 4;
const BYTES: u64 = 40 << 20;
/// The side of the largest blocks that a message proposes.
const LARGEST_PROPOSAL: u32 = 1 << 16;

/// Bounds of what is read of one grid.
#[derive(Clone, Debug)]
pub struct Limits {
    /// What messages call the grid.
    pub name: String,
    /// Bytes of a particle as it will be: its columns.
    pub row_bytes: u64,
    /// Bytes that a block needs besides while it is gathered.
    pub block_bytes: u64,
    /// Voxels along the side of a block.
    pub downsample: u32,
}

impl Limits {
    /// Bytes that tiles may need. Where the size of the file is unknown, what was read of it counts.
    pub fn tile_budget(input: &Input) -> u64 {
        BYTES_PER_BYTE.saturating_mul(input.size().unwrap_or_else(|| input.position())).saturating_add(BYTES)
    }

    /// Bytes for each particle with blocks of that side.
    fn bytes_each(&self, downsample: u32) -> u64 {
        self.row_bytes + if downsample > 1 { self.block_bytes } else { 0 }
    }

    /// Whether so many particles may come from tiles.
    pub fn allow_tiles(&self, particles: u128, input: &Input) -> bool {
        particles * u128::from(self.bytes_each(self.downsample)) <= u128::from(Self::tile_budget(input))
    }

    /// The error for tiles that stand for too many particles.
    pub fn too_many_in_tiles(&self, census: &Census, input: &Input) -> ReadError {
        let most = Self::tile_budget(input) / self.bytes_each(self.downsample);
        let blocks = if self.downsample > 1 { " even as blocks" } else { "" };
        ReadError::content(format!(
            "the tiles of grid `{}` stand for {} voxels, too many{blocks} for the size of the file; allowed: \
             {most} particles from tiles{}",
            self.name,
            census.tile_voxels(),
            self.proposal(census, input)
        ))
    }

    /// The error for too many particles in all.
    pub fn too_many(&self, census: &Census, input: &Input) -> ReadError {
        ReadError::content(format!(
            "grid `{}` has {} active voxels; allowed: at most {MAX_PARTICLES} particles{}",
            self.name,
            census.voxels(),
            self.proposal(census, input)
        ))
    }

    /// What to write instead, if anything helps.
    fn proposal(&self, census: &Census, input: &Input) -> String {
        let fits = |&side: &u32| {
            let (tiles, leaves) = most_blocks(census, side);
            tiles * u128::from(self.bytes_each(side)) <= u128::from(Self::tile_budget(input))
                && tiles + leaves <= u128::from(MAX_PARTICLES)
        };
        let sides = std::iter::successors(Some(2), |side| Some(side * 2)).take_while(|&side| side <= LARGEST_PROPOSAL);
        match sides.filter(|&side| side > self.downsample).find(fits) {
            Some(n) => format!(", which `downsample = {n}` (blocks of {n} x {n} x {n} voxels) attains"),
            None => String::new(),
        }
    }
}

/// How many blocks of a side that is a power of two hold tiles, and how many hold voxels of leaves, at most.
fn most_blocks(census: &Census, side: u32) -> (u128, u128) {
    // Both are powers of two and aligned.
    let blocks = |cube: i32| u128::from((cube.unsigned_abs() / side).max(1)).pow(3);
    let [small, middle, large] = census.tiles.map(u128::from);
    let [small_nodes, middle_nodes] = census.tile_nodes.map(u128::from);
    let tiles = (small * blocks(LEAF)).min(small_nodes * blocks(LOWER))
        + (middle * blocks(LOWER)).min(middle_nodes * blocks(UPPER))
        + large * blocks(UPPER);
    let leaves = u128::from(census.leaf_voxels)
        .min(u128::from(census.leaves) * blocks(LEAF))
        .min(u128::from(census.lower_nodes) * blocks(LOWER));
    (tiles, leaves)
}
