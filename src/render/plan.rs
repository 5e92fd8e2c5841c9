//! The plan: what is modelled and how, in plain words.

use super::method::{Mixing, slab};
use super::{Method, OpacityModel, Settings};
use crate::scene::Scene;
use serde_json::Value;

/// What is modelled and how, one sentence each.
pub fn words(scene: &Scene, settings: &Settings) -> Vec<String> {
    let method = settings.method;
    let mut words = vec![format!("{}: {}.", method.name(), method.help())];
    let parameters = method.parameters(scene);
    if !parameters.is_empty() {
        let list: Vec<_> = parameters
            .iter()
            .map(|(name, value)| match value {
                Value::String(text) => format!("{name} = {text}"),
                other => format!("{name} = {other}"),
            })
            .collect();
        words.push(format!("Parameters: {}.", list.join(", ")));
    }
    words.push(if method.has_opacity_model() {
        format!("Opacity follows the footprint by the {} model.", settings.opacity_model.name())
    } else {
        "Opacity is that of the optical depth -ln(1 - opacity) through the centre.".into()
    });
    words.push(if let Method::Reference(_) = method {
        "Nothing is left out and nothing ends early, whatever the tolerance.".into()
    } else if settings.tolerance > 0.0 {
        format!(
            "What lies behind nearly opaque gas is left out where it changes no channel by more than {:.6}.",
            settings.tolerance
        )
    } else {
        "No saving is taken: every particle reaches every pixel it covers.".into()
    });
    words.push(match method.mixing() {
        Mixing::Never => "Not modelled: light and shadow in the gas; particles that overlap do not mix.".into(),
        Mixing::WithinSlices => {
            "Not modelled: light and shadow in the gas; particles that overlap mix within a slice alone.".into()
        }
        Mixing::Everywhere => "Particles that overlap mix. Not modelled: light and shadow in the gas.".into(),
    });
    match method {
        Method::Slab(slab::Parameters { richardson, .. }) => words.push(format!(
            "The transmittance is exact but for rounding; the error of the colours is of {} in the thickness of a slab, where \
             slabs are thin.",
            if richardson { "a higher than the second order" } else { "the second order" }
        )),
        Method::Auto
        | Method::Viewplane
        | Method::Viewpoint
        | Method::Perspective
        | Method::Spherical(_)
        | Method::Sheet(_)
        | Method::Reference(_) => {}
    }
    if scene.meshes.is_empty() {
        words.push("No opaque surfaces.".into());
    }
    words
}

/// What of the scene the method leaves aside, one sentence each.
pub fn notes(scene: &Scene, settings: &Settings) -> Vec<String> {
    let method = settings.method;
    let name = method.name();
    let mut notes = Vec::new();
    if settings.opacity_model != OpacityModel::default() && !method.has_opacity_model() {
        let model = settings.opacity_model.name();
        notes.push(format!("method `{name}` always means optical depth: opacity_model `{model}` is ignored"));
    }
    if !method.has_kernels() {
        let mut kernels: Vec<_> =
            scene.particles.iter().filter(|set| !set.is_empty()).map(|set| set.kernel.name()).collect();
        kernels.sort_unstable();
        kernels.dedup();
        if !kernels.is_empty() {
            let list = kernels.join("`, `");
            notes.push(format!("method `{name}` has a falloff of its own: kernel `{list}` is ignored"));
        }
    }
    notes
}
