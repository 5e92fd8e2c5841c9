#![no_main]
stereomist_fuzz::mesh!("glTF", "gltf");
