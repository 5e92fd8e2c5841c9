//! TO WHAT: films, colour, stereo packings and image files. Knows no scene.

pub mod film;

pub use film::Film;
