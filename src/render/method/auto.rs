//! `auto`: the least work that stays within the tolerance. Ours.
//!
//! It draws the truth: optical depth from the closed forms, composited by slabs, on as few rays and with as few slabs as the
//! picture needs. See [`crate::render::cpu::adaptive`] for what is saved and how its error is known.

use super::perspective::Perspective;
use crate::error::Result;
use crate::render::cpu::adaptive;
use crate::render::cpu::slab::{self, Cut};
use crate::render::{Frame, Progress, Renderer, Statistics};
use crate::scene::Scene;

/// The renderer of the method.
pub struct Auto;

/// Slabs where nothing may be saved.
const BEST_SLABS: u32 = 512;

impl Renderer for Auto {
    fn supports(&self, _: &Scene) -> Result<()> {
        Ok(())
    }

    fn draw(&self, frame: Frame, progress: &dyn Progress) -> Statistics {
        if frame.options.tolerance > 0.0 {
            adaptive::draw(Perspective, frame, progress)
        } else {
            slab::draw(Cut::Equidistant { slabs: BEST_SLABS, richardson: true }, frame, progress)
        }
    }
}
