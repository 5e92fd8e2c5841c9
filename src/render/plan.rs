//! The plan: what is modelled and how, in plain words.

use super::{Method, OpacityModel, Settings};
use crate::scene::Scene;

/// What is modelled and how, one sentence each.
pub fn words(scene: &Scene, settings: &Settings) -> Vec<String> {
    let drawn = settings.method.resolve();
    let mut words = vec![if drawn == settings.method {
        format!("{}: {}.", drawn.name(), drawn.help())
    } else {
        format!(
            "{}: {}. Method {} means it until the planner is built.",
            drawn.name(),
            drawn.help(),
            settings.method.name()
        )
    }];
    if drawn == Method::Reference {
        words.push("Particles that overlap mix; opacity follows the optical depth; nothing ends early.".into());
        if settings.opacity_model == OpacityModel::Linear {
            words.push("The opacity model `linear` is left out: truth always means the optical depth.".into());
        }
        words.push("Not modelled: light and shadow in the gas.".into());
        if scene.meshes.is_empty() {
            words.push("No opaque surfaces.".into());
        }
        return words;
    }
    words.push(format!("Opacity follows the footprint by the {} model.", settings.opacity_model.name()));
    words.push(if settings.tolerance > 0.0 {
        format!(
            "What lies behind nearly opaque gas is left out where it changes no channel by more than {:.6}.",
            settings.tolerance
        )
    } else {
        "No saving is taken: every particle reaches every pixel it covers.".into()
    });
    words.push("Not modelled: light and shadow in the gas; particles that overlap do not mix.".into());
    if scene.meshes.is_empty() {
        words.push("No opaque surfaces.".into());
    }
    words
}
