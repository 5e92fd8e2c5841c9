use proptest::prelude::*;
use stereomist::picture::color::*;

#[test]
fn srgb_is_iec_61966() {
    // Values of the standard's own formulas, evaluated apart from the code.
    for (linear, encoded) in [
        (0.0, 0.0),
        (0.001, 0.01292),
        (0.18, 0.461_356_129_500_442),
        (0.5, 0.735_356_983_052_323),
        (1.0, 1.0),
        (-0.18, -0.461_356_129_500_442),
    ] {
        assert!((encode(linear) - encoded).abs() < 1e-12, "{linear}: {}", encode(linear));
        assert!((decode(encoded) - linear).abs() < 1e-12, "{encoded}: {}", decode(encoded));
    }
    assert!(encode(f64::NAN).is_nan() && decode(f64::NAN).is_nan());
    assert!((LUMINANCE.iter().sum::<f64>() - 1.0).abs() < 1e-15);
}

#[test]
fn quantising_rounds_and_clamps() {
    assert_eq!([0.499, 0.501, 254.499, 254.501].map(|v| quantise_u8(v / 255.0)), [0, 1, 254, 255]);
    assert_eq!([-1.0, 2.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(quantise_u8), [0, 255, 0, 255, 0]);
    assert_eq!([-1.0, 2.0, f64::NAN, 0.501 / 65535.0].map(quantise_u16), [0, 65535, 0, 1]);
    // Linear 0.5 is 187.516 of 255: truncation would give 187.
    assert_eq!(encode_u8(0.5), 188);
}

#[test]
fn every_code_comes_back() {
    assert!((0..=255).all(|code| encode_u8(decode_u8(code)) == code));
    assert!((0..=65535).all(|code| encode_u16(decode_u16(code)) == code));
}

fn slow(x: f32) -> (u8, u16) {
    (quantise_u8(encode(f64::from(x))), quantise_u16(encode(f64::from(x))))
}

/// Encoding is monotone: equal on both sides of every step means equal everywhere between.
#[test]
fn fast_encoding_is_exact_at_every_step() {
    for levels in [255, 65535_u32] {
        for k in 1..=levels {
            let step = decode((f64::from(k) - 0.5) / f64::from(levels)) as f32;
            let mut x = step.next_down().next_down();
            for _ in 0..5 {
                assert_eq!((encode_u8(x), encode_u16(x)), slow(x), "{x:e}");
                x = x.next_up();
            }
        }
    }
}

#[test]
fn fast_encoding_is_exact_over_all_floats() {
    // A stride prime to every power of two, over every sign, exponent, infinity and NaN.
    for bits in (0..=u32::MAX).step_by(9973) {
        let x = f32::from_bits(bits);
        assert_eq!((encode_u8(x), encode_u16(x)), slow(x), "{x:e}");
    }
}

proptest! {
    #[test]
    fn planes_encode_like_samples(values in prop::collection::vec(-0.5_f32..1.5, 1..50)) {
        let planes = [values.clone().into(), values.iter().map(|v| v * v).collect(), values.iter().map(|v| -v).collect()];
        let (eight, sixteen) = (interleave_u8(&planes), interleave_u16(&planes));
        for i in 0..values.len() {
            for c in 0..3 {
                prop_assert_eq!(eight[3 * i + c], encode_u8(planes[c][i]));
                prop_assert_eq!(sixteen[3 * i + c], encode_u16(planes[c][i]));
            }
        }
    }
}
