#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| stereomist_fuzz::fuzz_scene_file(bytes));
