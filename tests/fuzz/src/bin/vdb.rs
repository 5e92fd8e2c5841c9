#![no_main]
stereomist_fuzz::particles!("vdb");
