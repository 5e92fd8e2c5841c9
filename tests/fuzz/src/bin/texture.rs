#![no_main]
stereomist_fuzz::libfuzzer_sys::fuzz_target!(|bytes: &[u8]| stereomist_fuzz::fuzz_texture(bytes));
