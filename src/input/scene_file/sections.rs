//! What the keys of a scene file mean: from the tables of the document to a [`SceneFile`].

use super::SceneFile;
use super::method::method;
use super::reader::{Context, FINITE, Field, NOT_NEGATIVE, POSITIVE, Reader, Rule, suggest};
use super::text::Place;
use super::tree::{Table, Value};
use crate::error::Error;
use crate::input::VolumeOptions;
use crate::input::color_map::{COLOR_MAPS, ColorMap};
use crate::input::mesh::MeshEntry;
use crate::input::particles::{ColumnMap, MAX_BOX_COUNT, ParticleEntry, Source, Target};
use crate::input::profile::read_profile;
use crate::picture::{MAX_PIXELS, MAX_SIDE};
use crate::render::{OpacityModel, Settings};
use crate::scene::{Camera, Kernel, Rgb, Stereo, StereoMode};
use glam::DVec3;

/// Most samples of a view: width x height x samples^2.
const MAX_SAMPLES_IN_ALL: u64 = MAX_PIXELS;
/// Most samples along each side of a pixel.
const MAX_SAMPLES: u32 = 16;
/// Below this sine of the angle between `up` and the optical axis, rounding would decide which way is up.
const MIN_UP_SINE: f64 = 1e-9;

const SIZE: &str = "two integers from 1 to 32768, [width, height]";
/// Particles without a colour of their own.
const WHITE: Rgb = [1.0; 3];
/// Meshes without a colour of their own: light enough to shade, darker than fog.
const GREY: Rgb = [0.6; 3];

/// Checks the size of a view in pixels and its supersampling; the error says what is allowed.
///
/// Width and height are 1 to 32768, samples 1 to 16, and width x height x samples^2 at most 2^28.
pub fn check_size(size: [u32; 2], samples: u32) -> Result<(), String> {
    let [width, height] = size;
    if !size.iter().all(|side| (1..=MAX_SIDE).contains(side)) {
        return Err(format!("{width} x {height} pixels; allowed: width and height from 1 to {MAX_SIDE}"));
    }
    if !(1..=MAX_SAMPLES).contains(&samples) {
        return Err(format!("{samples} samples; allowed: 1 to {MAX_SAMPLES}"));
    }
    let per_side = u64::from(samples);
    let count = u64::from(width) * u64::from(height) * per_side * per_side;
    if count > MAX_SAMPLES_IN_ALL {
        let what = if samples == 1 { String::new() } else { format!(" with {samples} x {samples} samples each") };
        return Err(format!(
            "{width} x {height} pixels{what} are {count} in all; allowed: at most 2^28 = {MAX_SAMPLES_IN_ALL}"
        ));
    }
    Ok(())
}

/// Reads the whole document. `None`, or any problem reported, means that the scene is wrong.
pub(super) fn scene(context: Context<'_>, table: &Table) -> Option<SceneFile> {
    let mut reader = Reader::document(context, table);
    let mut notes = Vec::new();
    let camera = reader
        .require("camera", "[camera] with `position = [0.0, 1.5, 9.0]` and `look_at = [0.0, 1.5, 0.0]`")
        .and_then(|field| field.table("a table, headed [camera]"))
        .and_then(camera);
    let stereo = reader.get("stereo").and_then(|field| field.table("a table, headed [stereo]")).map(stereo);
    let background = reader
        .get("background")
        .and_then(|field| field.table("a table, headed [background], with `color = [red, green, blue]`"))
        .and_then(background);
    let particles: Vec<_> =
        reader.get("particles").iter().flat_map(Field::list).map(|reader| particles(context, reader)).collect();
    let meshes: Vec<_> = reader.get("mesh").iter().flat_map(Field::list).map(mesh).collect();
    let settings = reader.get("render").and_then(|field| field.table("a table, headed [render]")).map(render);
    reader.finish();

    if particles.is_empty() && meshes.is_empty() {
        notes.push("the scene has no [[particles]] and no [[mesh]]: only the background will be seen".to_owned());
    }
    if stereo.as_ref().is_some_and(|stereo| stereo.mode == StereoMode::ToeIn) {
        notes.push("stereo mode `toe-in` causes vertical parallax; it is there to show it".to_owned());
    }
    Some(SceneFile {
        camera: camera?,
        stereo,
        background: background.unwrap_or_default(),
        particles: particles.into_iter().collect::<Option<_>>()?,
        meshes: meshes.into_iter().collect::<Option<_>>()?,
        settings: settings.unwrap_or_default(),
        notes,
    })
}

fn camera(mut reader: Reader<'_>) -> Option<Camera> {
    const FOV: Rule = Rule { allowed: "degrees, greater than 0 and less than 180", test: |v| v > 0.0 && v < 180.0 };
    let position_field = reader.require("position", "`position = [0.0, 1.5, 9.0]`");
    let look_at_field = reader.require("look_at", "`look_at = [0.0, 1.5, 0.0]`");
    let up_field = reader.get("up");
    let fov_y_deg = number_or(reader.get("fov_y_deg"), &FOV, 40.0);
    let size_field = reader.get("size");
    let near = number_or(reader.get("near"), &POSITIVE, 0.01);
    let samples_field = reader.get("samples");
    reader.finish();

    let size = size_field.as_ref().map_or(Some([1024, 768]), |field| field.pair(1..=u64::from(MAX_SIDE), SIZE));
    let samples = samples_field.as_ref().map_or(Some(1), |field| field.integer(1..=u64::from(MAX_SAMPLES)));
    // Both came through the ranges above, so the conversions keep them.
    let size = size.map(|size| size.map(|side| side as u32));
    let samples = samples.map(|samples| samples as u32);
    if let (Some(size), Some(samples)) = (size, samples)
        && let Err(message) = check_size(size, samples)
    {
        // Too many pixels are the size's fault, too many samples of allowed pixels that of `samples`.
        let culprit = if check_size(size, 1).is_err() { &size_field } else { &samples_field };
        if let Some(field) = culprit.as_ref().or(size_field.as_ref()) {
            let (message, help) = message.split_once("; ").unwrap_or((&message, ""));
            field.report(format!("`{}`: {message}", field.path()), help);
        }
    }

    let position = position_field.as_ref().and_then(Field::vector);
    let look_at = look_at_field.as_ref().and_then(Field::vector);
    let up = up_field.as_ref().map_or(Some(DVec3::Y), Field::vector);
    let up_place = up_field.as_ref().map(Field::place);
    if up == Some(DVec3::ZERO)
        && let Some(field) = &up_field
    {
        field.refuse("a direction that is not zero");
    } else if let (Some(position), Some(look_at), Some(up)) = (position, look_at, up)
        && let (Some(from), Some(to)) = (&position_field, &look_at_field)
    {
        let later = from.later(to);
        match ((position - look_at).try_normalize(), up.try_normalize()) {
            (None, _) => {
                let message = "`camera.look_at` gives no direction from `camera.position`";
                later.report(message, "allowed: two points that differ, at a distance that can be computed with");
            }
            (_, None) => {
                if let Some(field) = &up_field {
                    field.refuse("a direction whose length can be computed with");
                }
            }
            (Some(back), Some(direction)) if direction.cross(back).length() < MIN_UP_SINE => {
                let message = format!("the camera looks along `camera.up`, [{}, {}, {}]", up.x, up.y, up.z);
                let field = up_field.as_ref().filter(|_| up_place.is_some_and(|place| place > later.place()));
                field.unwrap_or(later).report(message, "allowed: an `up` that is not parallel to the optical axis");
            }
            (Some(_), Some(_)) => {}
        }
    }
    Some(Camera {
        position: position?,
        look_at: look_at?,
        up: up?,
        fov_y: fov_y_deg.to_radians(),
        size: size?,
        near,
        samples: samples?,
    })
}

/// The number of a key, or the default where the key is absent or its value has been reported.
fn number_or(field: Option<Field<'_>>, rule: &Rule, default: f64) -> f64 {
    field.and_then(|field| field.number(rule)).unwrap_or(default)
}

fn stereo(mut reader: Reader<'_>) -> Stereo {
    const MODES: &[(&str, StereoMode)] = &[("parallel", StereoMode::Parallel), ("toe-in", StereoMode::ToeIn)];
    let interocular = number_or(reader.get("interocular"), &NOT_NEGATIVE, 0.065);
    let convergence_field = reader.get("convergence");
    let convergence = convergence_field.as_ref().and_then(|field| field.number(&POSITIVE));
    let mode_field = reader.get("mode");
    let mode = mode_field.as_ref().and_then(|field| field.choice(MODES)).unwrap_or_default();
    reader.finish();
    if let (StereoMode::ToeIn, None, Some(field)) = (mode, &convergence_field, &mode_field) {
        let help = "required with toe-in: `convergence`, the depth at which the axes meet; or mode = \"parallel\"";
        field.report("`stereo.mode` cannot be `toe-in` without `stereo.convergence`", help);
    }
    Stereo { interocular, convergence, mode }
}

fn background(mut reader: Reader<'_>) -> Option<Rgb> {
    let color = reader.get("color").and_then(|field| field.color());
    reader.finish();
    color
}

/// Where and how large a set or a mesh stands.
struct Placement {
    position: DVec3,
    rotation_deg: DVec3,
    scale: f64,
    /// Where the key `scale` stands, if it does.
    scale_place: Option<Place>,
}

fn placement(reader: &mut Reader<'_>) -> Placement {
    let position = reader.get("position").and_then(|field| field.vector());
    let rotation_deg = reader.get("rotation_deg").and_then(|field| field.vector());
    let scale = reader.get("scale");
    Placement {
        position: position.unwrap_or_default(),
        rotation_deg: rotation_deg.unwrap_or_default(),
        scale_place: scale.as_ref().map(Field::key_place),
        scale: number_or(scale, &POSITIVE, 1.0),
    }
}

fn particles(context: Context<'_>, mut reader: Reader<'_>) -> Option<ParticleEntry> {
    const OPACITY: Rule = Rule { allowed: "a number, 0 or more and less than 1", test: |v| (0.0..1.0).contains(&v) };
    let problems = context.problems;
    let radius = reader.get("radius").and_then(|field| field.number(&POSITIVE));
    let opacity = number_or(reader.get("opacity"), &OPACITY, 0.5);
    let color = reader.get("color").and_then(|field| field.color()).unwrap_or(WHITE);
    let kernel = reader.get("kernel").and_then(|field| kernel(&field)).unwrap_or_default();
    let Placement { position, rotation_deg, scale, scale_place } = placement(&mut reader);
    let fit_field = reader.get("fit");
    let fit = fit_field.as_ref().and_then(|field| field.number(&POSITIVE));
    let box_field = reader.get("box");
    let file_field = reader.get("file");
    let columns_field = reader.get("columns");
    let grid_field = reader.get("grid");
    let downsample_field = reader.get("downsample");

    if let (Some(scale), Some(fit)) = (scale_place, fit_field.as_ref().map(Field::key_place)) {
        let message = format!("`{}` and `{}` contradict", reader.path_of("scale"), reader.path_of("fit"));
        problems.report(scale.later(fit), message, "allowed: `scale`, a factor, or `fit`, the extent to scale to");
    }
    const EITHER: &str = "allowed: a [particles.box] with min, max, count and seed, or file = \"cloud.ply\"";
    match (&box_field, &file_field) {
        (Some(a), Some(b)) => {
            let message = format!("`{}` and `{}` contradict", a.path(), b.path());
            problems.report(a.key_place().later(b.key_place()), message, EITHER);
        }
        (None, None) => {
            let message = format!("neither `{}` nor `{}`", reader.path_of("box"), reader.path_of("file"));
            problems.report(reader.place(), message, EITHER);
        }
        (Some(_), None) | (None, Some(_)) => {}
    }
    if let (Some(_), None, Some(columns)) = (&box_field, &file_field, &columns_field) {
        let message = format!("`{}` without a file: the particles of a box have no columns", columns.path());
        problems.report(columns.key_place(), message, "allowed: columns together with `file`");
    }
    for field in [&grid_field, &downsample_field].into_iter().flatten() {
        if let (Some(_), None) = (&box_field, &file_field) {
            let message = format!("`{}` without a file: a box is no volume", field.path());
            problems.report(field.key_place(), message, "allowed: together with the `file` of a volume");
        }
    }
    reader.finish();

    let volume = VolumeOptions {
        grid: grid_field.and_then(|field| field.text("the name of a grid, in quotes").map(str::to_owned)),
        downsample: downsample_field.and_then(|field| field.integer(1..=MAX_DOWNSAMPLE)).unwrap_or(1) as u32,
    };
    let in_box = box_field.and_then(|field| field.table("a table, headed [particles.box]")).and_then(particle_box);
    let from_file = file_field.and_then(|field| field.file()).map(Source::File);
    let columns = columns_field
        .and_then(|field| field.table("a table, headed [particles.columns]"))
        .map_or_else(Vec::new, |reader| columns(context, reader));
    Some(ParticleEntry {
        source: in_box.or(from_file)?,
        radius,
        opacity,
        color,
        kernel,
        position,
        rotation_deg,
        scale,
        fit,
        columns,
        volume,
    })
}

/// The most voxels along a side of a block.
const MAX_DOWNSAMPLE: u64 = 4096;

fn kernel(field: &Field<'_>) -> Option<Kernel> {
    const ALLOWED: &str = "a kernel's name, or { table = \"profile.csv\" }";
    if let Value::String(name) = field.value() {
        let kernel = Kernel::from_name(name);
        if kernel.is_none() {
            let help = format!("{}, or {{ table = \"profile.csv\" }}", suggest(name, Kernel::NAMES));
            field.report(format!("`{}` cannot be `{name}`", field.path()), help);
        }
        return kernel;
    }
    let mut reader = field.table(ALLOWED)?;
    let table = reader.require("table", "{ table = \"profile.csv\" }");
    reader.finish();
    let table = table?;
    let path = table.file()?;
    let kernel = read_profile(&path)
        .map_err(|error| match error {
            // The path stands in the message already, as the scene file has it.
            Error::Input { message, .. } => message,
            other => other.to_string(),
        })
        .and_then(|(q, density)| Kernel::table(q, density));
    let refuse = |reason: String| {
        let help = "allowed: a CSV file of two columns, q from 0 to 1 and density";
        table.report(format!("`{}`: the profile cannot be used: {reason}", table.path()), help);
    };
    kernel.map_err(refuse).ok()
}

fn particle_box(mut reader: Reader<'_>) -> Option<Source> {
    let min_field = reader.require("min", "`min = [-3.0, 0.0, -3.0]`");
    let max_field = reader.require("max", "`max = [3.0, 3.0, 3.0]`");
    let count = reader.require("count", "`count = 1200`").map(|field| field.integer(0..=MAX_BOX_COUNT));
    let seed = reader.get("seed").map_or(Some(0), |field| field.integer(0..=u64::MAX));
    reader.finish();
    let min = min_field.as_ref().and_then(Field::vector);
    let max = max_field.as_ref().and_then(Field::vector);
    if let (Some(low), Some(high), Some(from), Some(to)) = (min, max, &min_field, &max_field)
        && let Some(axis) = (0..3).find(|&axis| low[axis] > high[axis])
    {
        let later = from.later(to);
        let message = format!(
            "`{}` is less than `{}` along {}: {} < {}",
            to.path(),
            from.path(),
            ["x", "y", "z"][axis],
            high[axis],
            low[axis]
        );
        later.report(message, "allowed: min <= max along every axis");
    }
    Some(Source::Box { min: min?, max: max?, count: count??, seed: seed? })
}

fn columns(context: Context<'_>, mut reader: Reader<'_>) -> Vec<ColumnMap> {
    let mut columns = Vec::new();
    let mut color_place = None;
    let mut component_place = None;
    for &target in Target::ALL {
        let Some(field) = reader.get(target.name()) else {
            continue;
        };
        match target {
            Target::Color => color_place = Some(field.key_place()),
            Target::R | Target::G | Target::B => component_place = Some(field.key_place()),
            Target::X | Target::Y | Target::Z | Target::Radius | Target::Opacity | Target::Extinction => {}
        }
        columns.extend(column(&field, target));
    }
    if let (Some(color), Some(component)) = (color_place, component_place) {
        let message = format!("`{}` and its r, g, b contradict", reader.path_of("color"));
        let help = "allowed: `color` through a map, or r, g and b from columns of their own";
        context.problems.report(color.later(component), message, help);
    }
    reader.finish();
    columns
}

fn column(field: &Field<'_>, target: Target) -> Option<ColumnMap> {
    const ALLOWED: &str = "a column's name, or { from = \"name\", scale = 1.0, offset = 0.0, min = 0.0, max = 1.0 }";
    let is_color = matches!(target, Target::Color);
    let list_maps = || format!("`map` (one of {}), `min` and `max`", color_map_names().join(", "));
    if let Value::String(_) = field.value() {
        let from = field.text(ALLOWED)?;
        if is_color {
            let help = format!("required: {{ from = \"{from}\", map = ..., min = ..., max = ... }}, {}", list_maps());
            field.report(format!("`{}` needs a colour map", field.path()), help);
            return None;
        }
        return Some(ColumnMap::plain(target, from));
    }
    let mut reader = field.table(ALLOWED)?;
    let from = reader.require("from", "{ from = \"name of a column\" }");
    let from = from.and_then(|field| field.text("the name of a column, in quotes"));
    let scale = number_or(reader.get("scale"), &FINITE, 1.0);
    let offset = number_or(reader.get("offset"), &FINITE, 0.0);
    let min_field = reader.get("min");
    let max_field = reader.get("max");
    let map_field = reader.get("map");
    reader.finish();

    let min = min_field.as_ref().and_then(|field| field.number(&FINITE));
    let max = max_field.as_ref().and_then(|field| field.number(&FINITE));
    let map = map_field.as_ref().and_then(color_map);
    match (&map_field, is_color) {
        (Some(map), false) => {
            map.report(format!("`{}` is for color only", map.path()), "allowed: map in `color = { ... }`");
        }
        (None, true) => {
            field.report(format!("`{}` needs a colour map", field.path()), format!("required: {}", list_maps()));
        }
        (Some(_), true) if min_field.is_none() || max_field.is_none() => {
            let message = format!("`{}` needs the values at both ends of its map", field.path());
            field.report(message, "required: min and max, with min < max");
        }
        (Some(_), true) | (None, false) => {}
    }
    if let (Some(low), Some(high), Some(from), Some(to)) = (min, max, &min_field, &max_field)
        && (low > high || (is_color && low == high))
    {
        let later = from.later(to);
        let rule = if is_color { "min < max" } else { "min <= max" };
        later.report(format!("`{}` has min {low} and max {high}", field.path()), format!("allowed: {rule}"));
    }
    Some(ColumnMap { target, from: from?.to_owned(), scale, offset, min, max, map })
}

fn color_map(field: &Field<'_>) -> Option<ColorMap> {
    let name = field.text("the name of a colour map, in quotes")?;
    let map = ColorMap::from_name(name);
    if map.is_none() {
        field.refuse_name(name, &color_map_names());
    }
    map
}

fn color_map_names() -> Vec<&'static str> {
    COLOR_MAPS.iter().map(|map| map.name).collect()
}

fn mesh(mut reader: Reader<'_>) -> Option<MeshEntry> {
    let file = reader.require("file", "`file = \"watertower.gltf\"`").and_then(|field| field.file());
    let Placement { position, rotation_deg, scale, .. } = placement(&mut reader);
    let color = reader.get("color").and_then(|field| field.color()).unwrap_or(GREY);
    reader.finish();
    Some(MeshEntry { file: file?, position, rotation_deg, scale, color })
}

fn render(mut reader: Reader<'_>) -> Settings {
    const MODELS: &[(&str, OpacityModel)] =
        &[("exponential", OpacityModel::Exponential), ("linear", OpacityModel::Linear)];
    let method = reader.get("method").and_then(|field| method(&field)).unwrap_or_default();
    let opacity_model = reader.get("opacity_model").and_then(|field| field.choice(MODELS)).unwrap_or_default();
    reader.finish();
    Settings { method, opacity_model, ..Settings::default() }
}
