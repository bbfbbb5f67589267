//! The inputs of `meshes/`, one function each: skins that stand for what robots wear.
//!
//! The same bytes come out every time and everywhere: where a shape needs more than `+ - * /` and
//! square roots, which are the same on all machines, its positions are rounded to [`grid::STEP`]
//! before anything else is computed from them.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

mod delaunay;
pub mod forearm;
pub mod glove;
pub mod grid;
pub mod hand;
pub mod robot;
pub mod saddle;
pub mod sleeve;
pub mod sphere_cap;

use dermatome::skin::Skin;

/// Makes one of the skins.
pub type Generator = fn() -> Skin;

/// Every skin with the stem of its file.
pub const ALL: [(&str, Generator); 7] = [
    ("sphere_cap", sphere_cap::sphere_cap),
    ("forearm", forearm::forearm),
    ("hand", hand::hand),
    ("robot_hand", hand::robot_hand),
    ("glove", glove::glove),
    ("saddle", saddle::saddle),
    ("robot", robot::robot),
];
