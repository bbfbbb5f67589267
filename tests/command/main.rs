//! The command as a user runs it: a module for each subcommand or promise, and the pages that show commands.

#[path = "../library/altered.rs"]
mod altered;
mod atlas;
mod bare;
mod bodies;
mod body;
mod build;
mod calibrate;
mod chosen;
mod cli;
#[path = "../common/mod.rs"]
mod common;
mod cuts;
mod design;
mod events;
mod experiment;
mod export;
mod health;
mod json;
mod laws;
mod lookup;
#[path = "../library/maps/mod.rs"]
mod maps;
mod order;
mod outputs;
mod patterns;
mod reading;
mod readme;
mod regions;
mod render;
mod response;
mod robot;
mod skin_laws;
mod skins;
mod summary;
mod touch;
mod touches;
mod touches_laws;
mod zoo;
