// The light's own estimate of its error.
const ESTIMATE: bool = true;

// Per pixel: by channel, with its sign; and the largest of the three without.
@group(0) @binding(8) var<storage, read_write> errors: array<vec4<f32>>;

fn off_so_far(inside: bool, number: u32) -> vec3<f32> {
    if !inside || (view.flags & FIRST) != 0u {
        return vec3<f32>(0.0);
    }
    return errors[number].rgb;
}

fn write_off(number: u32, off: vec3<f32>) {
    let size = abs(off);
    errors[number] = vec4<f32>(off, max(max(size.x, size.y), size.z));
}
