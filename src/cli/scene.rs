//! `scene`: what a file holds and, for a scene file, how it would be rendered. What `auto` saves depends on what it finds in the
//! pictures: it draws a frame in memory to say that.

use super::contents;
use super::options::SceneOptions;
use super::progress::Bar;
use super::{ms, parameters, print, print_json};
use crate::error::{Error, Result};
use crate::input::{Kind, SceneInput};
use crate::render::{Method, Session, Statistics, plan};
use crate::scene::{Attribute, ParticleSet, StereoMode};
use clap::Args;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Arguments of `scene`.
#[derive(Args)]
pub struct SceneArgs {
    #[command(flatten)]
    options: SceneOptions,

    /// Print one JSON object
    #[arg(long)]
    json: bool,

    /// Print a ready scene file for a file of particles, a volume or a mesh
    #[arg(long, conflicts_with = "json")]
    init: bool,
}

/// What predicted errors are against.
const TRUTH: &str = "the truth";
const ITSELF: &str = "the same method without savings";

/// A frame drawn to know what a method that looks for savings finds.
struct Trial {
    error: Option<f64>,
    /// What its plan foretells.
    predicted: Option<Duration>,
    /// Of the second frame if the first was fast, which finds memory ready.
    time: Duration,
}

/// Longest first frame that is drawn again.
const FAST: Duration = Duration::from_millis(500);

impl Trial {
    /// Draws, and adds what was found to the plan.
    fn new(input: &SceneInput, plan: &mut Vec<String>, bar: Bar) -> Result<Self> {
        let mut session = Session::new(&input.settings)?;
        let mut start = Instant::now();
        let mut drawn = session.draw(&input.scene, &bar)?;
        if start.elapsed() < FAST {
            session.recycle(drawn);
            start = Instant::now();
            drawn = session.draw(&input.scene, &bar)?;
        }
        let time = start.elapsed();
        plan.append(&mut drawn.statistics.plan);
        let Statistics { predicted_error, predicted_time, .. } = drawn.statistics;
        Ok(Self { error: predicted_error, predicted: predicted_time, time })
    }
}

impl SceneArgs {
    /// Runs the command; returns the exit code.
    pub fn run(&self) -> Result<u8> {
        let bar = Bar::new("reading", self.json);
        match self.options.kind()? {
            Kind::Scene if self.init => {
                let path = self.options.scene.display();
                return Err(Error::Usage(format!(
                    "--init: {path} is no file of particles, volume or mesh to make a scene of"
                )));
            }
            Kind::Scene => {}
            Kind::Particles(_) | Kind::Mesh(_) if self.init => {
                let text = self.options.init(&bar)?;
                drop(bar);
                return print(&text).map(|()| 0);
            }
            Kind::Particles(reader) => {
                return contents::particles(&self.options.scene, reader, &self.options.volume(), self.json, bar);
            }
            Kind::Mesh(reader) => return contents::mesh(&self.options.scene, reader, self.json),
        }
        drop(bar);
        let input = self.options.load(self.json)?;
        let scene = &input.scene;
        let camera = &scene.camera;
        let views = scene.views();
        // Depths of the particles in front of the camera, along its axis.
        let forward = -camera.camera_from_world().row(2);
        let [mut nearest, mut farthest] = [f64::INFINITY, f64::NEG_INFINITY];
        let mut behind = 0usize;
        for set in &scene.particles {
            for i in 0..set.len() {
                let depth = forward.dot(glam::DVec3::new(set.x[i], set.y[i], set.z[i]) - camera.position);
                if depth <= camera.near {
                    behind += 1;
                } else {
                    nearest = nearest.min(depth);
                    farthest = farthest.max(depth);
                }
            }
        }
        let depths = (nearest <= farthest).then_some([nearest, farthest]);
        // I (1 - D/d) is a length in the zero-parallax plane; it holds for parallel axes and needs that plane.
        let stereo = scene.stereo.as_ref().filter(|stereo| stereo.mode == StereoMode::Parallel);
        let parallax =
            stereo.zip(depths).and_then(|(stereo, [near, far])| Some([stereo.parallax(near)?, stereo.parallax(far)?]));
        let mut plan = plan::words(scene, &input.settings);
        let trial = match input.settings.method {
            Method::Auto => Some(Trial::new(&input, &mut plan, Bar::new("planning", self.json))?),
            Method::Viewplane
            | Method::Viewpoint
            | Method::Perspective
            | Method::Spherical(_)
            | Method::Sheet(_)
            | Method::Slab(_)
            | Method::Reference(_) => None,
        };
        // Of the best that `auto` can do nothing is known.
        let predicted = match &trial {
            Some(trial) => trial.error,
            None => Some(input.settings.tolerance),
        };
        if self.json {
            let sets: Vec<Value> = scene.particles.iter().map(describe_json).collect();
            let meshes: Vec<Value> = scene
                .meshes
                .iter()
                .map(|mesh| json!({ "name": mesh.name, "triangles": mesh.corners.len(), "textures": mesh.textures.len() }))
                .collect();
            return print_json(&json!({
                "size": camera.size,
                "views": views.len(),
                "particles": scene.particle_count(),
                "sets": sets,
                "meshes": meshes,
                "behind_near_plane": behind,
                "depths": depths,
                "parallax": parallax,
                "method": input.settings.method.name(),
                "parameters": parameters(input.settings.method, scene),
                "tolerance": input.settings.tolerance,
                "predicted_error": predicted,
                "predicted_error_against": if trial.is_some() { TRUTH } else { ITSELF },
                "predicted_ms": trial.as_ref().and_then(|trial| trial.predicted).map(ms),
                "drawn_ms": trial.as_ref().map(|trial| ms(trial.time)),
                "plan": plan,
                "notes": input.notes,
            }))
            .map(|()| 0);
        }
        let mut text = format!(
            "{}: {} x {}x{}, {} particles, {} meshes\n",
            self.options.scene.display(),
            views.len(),
            camera.size[0],
            camera.size[1],
            scene.particle_count(),
            scene.meshes.len()
        );
        for set in &scene.particles {
            text += &format!("  {}\n", describe(set));
        }
        for mesh in &scene.meshes {
            text +=
                &format!("  mesh {}: {} triangles, {} textures\n", mesh.name, mesh.corners.len(), mesh.textures.len());
        }
        if let Some([nearest, farthest]) = depths {
            text += &format!("  depths of particles {nearest:.4} to {farthest:.4}\n");
        }
        if behind > 0 {
            text += &format!("  {behind} particles are behind the near plane\n");
        }
        if let Some([near, far]) = parallax {
            text += &format!(
                "  screen parallax {near:+.4} (nearest) to {far:+.4} (farthest); positive is behind the screen\n"
            );
        }
        for sentence in &plan {
            text += &format!("- {sentence}\n");
        }
        let against = if trial.is_some() { TRUTH } else { ITSELF };
        if let Some(predicted) = predicted {
            text += &format!("- Predicted error against {against}: at most {predicted:.6} per channel.\n");
        }
        if let Some(trial) = trial {
            if let Some(predicted) = trial.predicted {
                text += &format!("- Predicted time: {:.2} ms for the gas of all views, by the plan.\n", ms(predicted));
            }
            text += &format!("- The frame that was drawn to plan this took {:.2} ms, all included.\n", ms(trial.time));
        }
        for note in &input.notes {
            text += &format!("note: {note}\n");
        }
        print(&text)?;
        Ok(0)
    }
}

fn extent(set: &ParticleSet) -> [[f64; 2]; 3] {
    [&set.x, &set.y, &set.z].map(|axis| range(axis))
}

fn range(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &v| [low.min(v), high.max(v)])
}

fn describe(set: &ParticleSet) -> String {
    let [x, y, z] = extent(set);
    let span = |name: &str, [low, high]: [f64; 2]| {
        if low == high { format!("{name} {low}") } else { format!("{name} {low:.4} to {high:.4}") }
    };
    let color = match &set.color {
        Attribute::Uniform([r, g, b]) => format!("colour {r} {g} {b}"),
        Attribute::Each(_) => "a colour each".into(),
    };
    if set.is_empty() {
        return "no particles".into();
    }
    format!(
        "{} particles, {}, {}, {}, {color}; {}, {}, {}",
        set.len(),
        set.kernel.name(),
        span("radius", range(set.radius.values())),
        span("opacity", range(set.opacity.values())),
        span("x", x),
        span("y", y),
        span("z", z)
    )
}

fn describe_json(set: &ParticleSet) -> Value {
    let [x, y, z] = extent(set);
    json!({
        "count": set.len(),
        "kernel": set.kernel.name(),
        "radius": range(set.radius.values()),
        "opacity": range(set.opacity.values()),
        "one_color": matches!(set.color, Attribute::Uniform(_)),
        "extent": { "x": x, "y": y, "z": z },
    })
}
