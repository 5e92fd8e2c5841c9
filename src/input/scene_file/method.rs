//! The method of `[render]`, with its parameters.

use super::reader::{Field, POSITIVE, Reader, suggest};
use super::tree::Value;
use crate::render::method::{sheet, slab, spherical};
use crate::render::{Method, reference};

/// A method's name, or a table of one key: the name, with a table of its parameters.
pub(super) fn method(field: &Field<'_>) -> Option<Method> {
    const ALLOWED: &str = "a method's name, or a table of one method with its parameters, { name = { ... } }";
    let built: Vec<_> = Method::ALL.iter().map(|method| method.name()).collect();
    let (name, given) = match field.value() {
        Value::String(name) => (name, None),
        Value::Table(table) => match &table.entries[..] {
            [entry] => (&entry.key, Some(entry)),
            [] => {
                field.refuse(ALLOWED);
                return None;
            }
            // A setting of one method's parameter where the file has another: which of them is meant is not known.
            [first, .., last] => {
                let message = format!("`{}` names more than one method: {}, {}", field.path(), first.key, last.key);
                let help =
                    format!("allowed: one; --set {}={} before its parameters changes it", field.path(), last.key);
                field.report_at(last.key_place, message, help);
                return None;
            }
        },
        Value::Integer(_) | Value::Float(_) | Value::Boolean(_) | Value::Datetime | Value::Array(_) => {
            field.refuse_type(ALLOWED);
            return None;
        }
    };
    let place = given.map_or(field.place(), |entry| entry.key_place);
    let Some(method) = Method::from_name(name) else {
        field.report_at(place, format!("`{}` cannot be `{name}`", field.path()), suggest(name, &built));
        return None;
    };
    let Some(entry) = given else {
        return Some(method);
    };
    let Value::Table(table) = &entry.node.value else {
        let help = format!("allowed: \"{name}\", or {{ {name} = {{}} }}");
        field.report_at(entry.node.place, format!("the parameters of `{name}` are no table"), help);
        return Some(method);
    };
    let reader = field.inside(entry, table);
    Some(match method {
        Method::Auto | Method::Viewplane | Method::Viewpoint | Method::Perspective => {
            for entry in &table.entries {
                let message = format!("method `{name}` has no parameter `{}`", entry.key);
                field.report_at(entry.key_place, message, "it takes none");
            }
            method
        }
        Method::Spherical(default) => Method::Spherical(spherical(reader, default)),
        Method::Sheet(default) => Method::Sheet(sheet(reader, default)),
        Method::Slab(default) => Method::Slab(slab(reader, default)),
        Method::Reference(default) => Method::Reference(reference(reader, default)),
    })
}

/// The value of a key that takes one of `all`, or the default where the key is absent or its value has been reported.
fn name_or<T: Copy>(field: Option<Field<'_>>, all: &[T], name: fn(T) -> &'static str, default: T) -> T {
    let choices: Vec<_> = all.iter().map(|&value| (name(value), value)).collect();
    field.and_then(|field| field.choice(&choices)).unwrap_or(default)
}

fn spherical(mut reader: Reader<'_>, default: spherical::Parameters) -> spherical::Parameters {
    use spherical::{Falloff, Parameters, Quad, Rays};
    let falloff = name_or(reader.get("falloff"), Falloff::ALL, Falloff::name, default.falloff);
    let rays = name_or(reader.get("rays"), Rays::ALL, Rays::name, default.rays);
    let quad = name_or(reader.get("quad"), Quad::ALL, Quad::name, default.quad);
    reader.finish();
    Parameters { falloff, rays, quad }
}

fn sheet(mut reader: Reader<'_>, default: sheet::Parameters) -> sheet::Parameters {
    use sheet::{Lookup, Parameters};
    let slice_width = reader.get("slice_width").and_then(|field| field.number(&POSITIVE));
    let segments = reader.get("segments").and_then(|field| field.integer(2..=u64::from(Parameters::MAX_SEGMENTS)));
    let lookup = name_or(reader.get("lookup"), Lookup::ALL, Lookup::name, default.lookup);
    reader.finish();
    // Within the range above, so that the conversion keeps it.
    let segments = segments.map_or(default.segments, |segments| segments as u32);
    Parameters { slice_width: slice_width.or(default.slice_width), segments, lookup }
}

fn slab(mut reader: Reader<'_>, default: slab::Parameters) -> slab::Parameters {
    use slab::Parameters;
    let slabs = reader.get("slabs").and_then(|field| field.integer(1..=u64::from(Parameters::MAX_SLABS)));
    let richardson = reader.get("richardson").and_then(|field| field.boolean());
    reader.finish();
    // Within the range above, so that the conversion keeps it.
    let slabs = slabs.map(|slabs| slabs as u32).or(default.slabs);
    Parameters { slabs, richardson: richardson.unwrap_or(default.richardson) }
}

fn reference(mut reader: Reader<'_>, default: reference::Parameters) -> reference::Parameters {
    let disparity = reader.get("disparity").and_then(|field| field.boolean()).unwrap_or(default.disparity);
    reader.finish();
    reference::Parameters { disparity }
}
