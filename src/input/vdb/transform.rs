//! From a grid's index space, in which voxel centres have integer coordinates, to the space of the file.

use super::super::columns::{ReadError, quote};
use super::bytes::Input;

/// Linear maps that are read, as error messages name them.
const ALLOWED: &str = "UniformScaleMap, ScaleMap, TranslationMap, UniformScaleTranslateMap, ScaleTranslateMap, \
                       AffineMap, UnitaryMap";
/// Index coordinates have 32 bits; a block's centre lies within that, too.
const LARGEST_COORDINATE: f64 = (1u64 << 32) as f64;

/// An affine map: p = i X + j Y + k Z + O.
#[derive(Clone, Debug, PartialEq)]
pub struct Transform {
    /// The images X, Y and Z of one step along each index axis.
    steps: [[f64; 3]; 3],
    /// The image O of index (0, 0, 0).
    origin: [f64; 3],
}

impl Transform {
    /// Reads the map of a grid.
    pub fn read(input: &mut Input) -> Result<Self, ReadError> {
        const WHAT: &str = "the transform of a grid";
        let place = input.position();
        let name = input.text(WHAT)?;
        let mut numbers =
            |count: usize| -> Result<Vec<f64>, ReadError> { (0..count).map(|_| input.f64(WHAT)).collect() };
        let scale = |v: &[f64]| [[v[0], 0.0, 0.0], [0.0, v[1], 0.0], [0.0, 0.0, v[2]]];
        let transform = match name.as_str() {
            // Scale, size of a voxel, inverse of the scale, its square, half of it: all but the first follow from it.
            "UniformScaleMap" | "ScaleMap" => Self { steps: scale(&numbers(15)?), origin: [0.0; 3] },
            "TranslationMap" => {
                let v = numbers(3)?;
                Self { steps: scale(&[1.0; 3]), origin: [v[0], v[1], v[2]] }
            }
            "UniformScaleTranslateMap" | "ScaleTranslateMap" => {
                let v = numbers(18)?;
                Self { steps: scale(&v[3..]), origin: [v[0], v[1], v[2]] }
            }
            "AffineMap" | "UnitaryMap" => {
                // A matrix M in row-major order, of which a row vector is the left factor: p = (i, j, k, 1) M.
                let m = numbers(16)?;
                if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] {
                    return Err(ReadError::content(format!(
                        "byte {place}: the last column of the matrix is {}, {}, {}, {}; allowed: 0, 0, 0, 1",
                        m[3], m[7], m[11], m[15]
                    )));
                }
                let row = |r: usize| [m[4 * r], m[4 * r + 1], m[4 * r + 2]];
                Self { steps: [row(0), row(1), row(2)], origin: row(3) }
            }
            "NonlinearFrustumMap" => {
                return Err(ReadError::content(format!(
                    "byte {place}: transform NonlinearFrustumMap, the voxels of a camera's view, is not supported; \
                     allowed: {ALLOWED}. Resample the grid to such a one"
                )));
            }
            _ => {
                let name = quote(name.as_bytes());
                return Err(ReadError::content(format!("byte {place}: transform {name}; allowed: {ALLOWED}")));
            }
        };
        transform.check(place)?;
        Ok(transform)
    }

    /// Refuses maps that squash space or take an index to infinity.
    fn check(&self, place: u64) -> Result<(), ReadError> {
        let wrong = |message: String| Err(ReadError::content(format!("byte {place}: the grid's transform {message}")));
        let volume = self.voxel_volume();
        if !(volume.is_finite() && volume > 0.0) {
            return wrong(format!("gives voxels the volume {volume}; allowed: a finite one greater than 0"));
        }
        for axis in 0..3 {
            let largest: f64 = self.steps.iter().map(|step| step[axis].abs() * LARGEST_COORDINATE).sum();
            if !(largest + self.origin[axis].abs()).is_finite() {
                return wrong("has numbers too large for coordinates".to_owned());
            }
        }
        Ok(())
    }

    /// One coordinate of the image of an index; finite for all indices of 32 bits.
    pub fn coordinate(&self, axis: usize, index: [f64; 3]) -> f64 {
        let [x, y, z] = &self.steps;
        index[0] * x[axis] + index[1] * y[axis] + index[2] * z[axis] + self.origin[axis]
    }

    /// Volume of a voxel.
    pub fn voxel_volume(&self) -> f64 {
        let [x, y, z] = self.steps;
        let cross = [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]];
        (x[0] * cross[0] + x[1] * cross[1] + x[2] * cross[2]).abs()
    }

    /// Lengths of the sides of a voxel.
    pub fn voxel_size(&self) -> [f64; 3] {
        self.steps.map(|[x, y, z]| x.hypot(y).hypot(z))
    }
}
