//! Tests of the tracers by their results, in one program: each program of its own would link the whole
//! crate and its dependencies again.

mod cpu;
mod denoise;
mod dielectric_meshes;
mod emissive_surfaces;
mod environments;
mod extremes;
mod gpu;
mod images;
mod laws;
mod layers;
mod materials;
mod meshes;
mod opacity;
mod particles;
mod punctual_lights;
mod reference;
mod reprojection;
mod scenes;
mod textures;
mod thin_walls;
mod tracers;
mod vectors;
