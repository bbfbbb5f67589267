//! g2o text (Kuemmerle et al. 2011): one vertex, edge or parameter a line.

use std::{
    collections::HashMap,
    fmt::Write as _,
    io::{self, BufRead, Write},
    path::Path,
};

use glam::DVec3;

use crate::{
    calib::{Information, Model, Motion, Observations, Pose, PosePrior, RelativePose, Touch},
    io::{
        IoError,
        observations::ReadObservations,
        observations_builder::Builder,
        observations_lines::{Lines, Place},
    },
};

/// The number g2o files give to the one offset that is written here.
const IDENTITY_OFFSET: u32 = 0;

pub(super) fn read(mut lines: Lines<'_, impl BufRead>, path: &Path) -> Result<ReadObservations, IoError> {
    let mut builder = Builder::new(path);
    let mut offsets = HashMap::new();
    let mut numbers = Vec::new();
    while let Some((line, at)) = lines.current() {
        let mut words = line.split_ascii_whitespace();
        if let Some(tag) = words.next() {
            read_line(tag, words, &mut numbers, &mut offsets, &mut builder, &at)?;
        }
        lines.advance()?;
    }
    builder.finish()
}

/// Reads what follows the first word of a line.
fn read_line<'w>(
    tag: &str,
    mut words: impl Iterator<Item = &'w str>,
    numbers: &mut Vec<f64>,
    offsets: &mut HashMap<u32, Pose>,
    builder: &mut Builder<'_>,
    at: &Place<'_>,
) -> Result<(), IoError> {
    let mut id = || at.taxel(words.next().ok_or_else(|| truncated(tag, at))?);
    match tag {
        "VERTEX_SE3:QUAT" => {
            let id = id()?;
            builder.set_model(Model::Poses, at)?;
            let pose = builder.pose(exactly(7, tag, words, numbers, at)?, at)?;
            builder.taxel(id, pose, at)
        }
        "VERTEX_TRACKXYZ" => {
            let id = id()?;
            builder.set_model(Model::Positions, at)?;
            let p = exactly(3, tag, words, numbers, at)?;
            builder.taxel(id, Pose::at(DVec3::new(p[0], p[1], p[2])), at)
        }
        "EDGE_SE3:QUAT" => {
            let ids = [id()?, id()?];
            builder.set_model(Model::Poses, at)?;
            let numbers = exactly(28, tag, words, numbers, at)?;
            let pose = builder.pose(&numbers[..7], at)?;
            let information = information(&numbers[7..], tag, at)?;
            builder.edge(ids, Motion::Relative(Box::new(RelativePose { pose, information })), at)
        }
        "EDGE_POINTXYZ" => {
            let ids = [id()?, id()?];
            builder.set_model(Model::Positions, at)?;
            let numbers = exactly(9, tag, words, numbers, at)?;
            let offset = DVec3::new(numbers[0], numbers[1], numbers[2]);
            builder.edge(
                ids,
                Motion::Offset { offset, information: information(&numbers[3..], tag, at)? },
                at,
            )
        }
        "EDGE_POINTXYZ_PRIOR" => {
            let id = id()?;
            let numbers = exactly(9, tag, words, numbers, at)?;
            let position = DVec3::new(numbers[0], numbers[1], numbers[2]);
            let information = information(&numbers[3..], tag, at)?;
            builder.contact(id, Touch::Position { position, information }, at)
        }
        "EDGE_SE3_PRIOR" => {
            let (id, parameter) = (id()?, id()?.0);
            builder.set_model(Model::Poses, at)?;
            let numbers = exactly(28, tag, words, numbers, at)?;
            let pose = builder.pose(&numbers[..7], at)?;
            let needed = "the number of a PARAMS_SE3OFFSET line before this one";
            let offset = *offsets
                .get(&parameter)
                .ok_or_else(|| at.invalid(format!("parameter {parameter}"), needed))?;
            let information = information(&numbers[7..], tag, at)?;
            builder.contact(id, Touch::Pose(Box::new(PosePrior { pose, offset, information })), at)
        }
        "PARAMS_SE3OFFSET" => {
            let parameter = id()?.0;
            let pose = builder.pose(exactly(7, tag, words, numbers, at)?, at)?;
            match offsets.insert(parameter, pose) {
                Some(_) => {
                    let found = format!("parameter {parameter} a second time");
                    Err(at.invalid(found, "every parameter declared once"))
                }
                None => Ok(()),
            }
        }
        "FIX" => {
            builder.fix(id()?, at);
            for word in words {
                builder.fix(at.taxel(word)?, at);
            }
            Ok(())
        }
        _ => {
            builder.unknown_tag(tag);
            Ok(())
        }
    }
}

fn truncated(tag: &str, at: &Place<'_>) -> IoError {
    at.invalid(format!("a {tag} line that ends too soon"), "the numbers of taxels, then the values")
}

/// The remaining words as `count` finite numbers.
fn exactly<'n, 'w>(
    count: usize,
    tag: &str,
    words: impl Iterator<Item = &'w str>,
    numbers: &'n mut Vec<f64>,
    at: &Place<'_>,
) -> Result<&'n [f64], IoError> {
    numbers.clear();
    for word in words {
        numbers.push(at.number(word)?);
    }
    if numbers.len() != count {
        return Err(
            at.invalid(format!("{} numbers after the ids of {tag}", numbers.len()), count.to_string())
        );
    }
    Ok(numbers)
}

fn information<const N: usize>(upper: &[f64], tag: &str, at: &Place<'_>) -> Result<Information<N>, IoError> {
    Information::from_upper(upper).ok_or_else(|| truncated(tag, at))
}

pub(super) fn write(out: &mut impl Write, observations: &Observations, path: &Path) -> Result<(), IoError> {
    let fail = |source: io::Error| IoError::Write { path: path.to_owned(), source };
    let Observations { model, taxels, edges, contacts } = observations;
    let mut line = String::new();
    let mut emit = |line: &mut String| {
        line.push('\n');
        let done = out.write_all(line.as_bytes()).map_err(fail);
        line.clear();
        done
    };
    let mut offsets: Vec<Pose> = vec![Pose::IDENTITY];
    for contact in contacts {
        if let Touch::Pose(prior) = &contact.touch
            && !offsets.contains(&prior.offset)
        {
            offsets.push(prior.offset);
        }
    }
    if contacts.iter().any(|c| matches!(c.touch, Touch::Pose(_))) {
        for (k, offset) in (IDENTITY_OFFSET..).zip(&offsets) {
            push(&mut line, format_args!("PARAMS_SE3OFFSET {k}"));
            push_pose(&mut line, offset);
            emit(&mut line)?;
        }
    }
    for taxel in taxels {
        let initial = taxel.initial.unwrap_or(Pose::IDENTITY);
        match model {
            Model::Positions => {
                push(&mut line, format_args!("VERTEX_TRACKXYZ {}", taxel.id));
                push_numbers(&mut line, initial.position.to_array());
            }
            Model::Poses => {
                push(&mut line, format_args!("VERTEX_SE3:QUAT {}", taxel.id));
                push_pose(&mut line, &initial);
            }
        }
        emit(&mut line)?;
    }
    for taxel in taxels.iter().filter(|t| t.fixed) {
        push(&mut line, format_args!("FIX {}", taxel.id));
        emit(&mut line)?;
    }
    for edge in edges {
        let ids = [taxels[edge.from].id, taxels[edge.to].id];
        match &edge.motion {
            Motion::Offset { offset, information } => {
                push(&mut line, format_args!("EDGE_POINTXYZ {} {}", ids[0], ids[1]));
                push_numbers(&mut line, offset.to_array());
                push_numbers(&mut line, information.upper());
            }
            Motion::Relative(m) => {
                push(&mut line, format_args!("EDGE_SE3:QUAT {} {}", ids[0], ids[1]));
                push_pose(&mut line, &m.pose);
                push_numbers(&mut line, m.information.upper());
            }
        }
        emit(&mut line)?;
    }
    for contact in contacts {
        let id = taxels[contact.taxel].id;
        match &contact.touch {
            Touch::Position { position, information } => {
                push(&mut line, format_args!("EDGE_POINTXYZ_PRIOR {id}"));
                push_numbers(&mut line, position.to_array());
                push_numbers(&mut line, information.upper());
            }
            Touch::Pose(prior) => {
                let k = offsets.iter().position(|o| *o == prior.offset).unwrap_or_default();
                push(&mut line, format_args!("EDGE_SE3_PRIOR {id} {k}"));
                push_pose(&mut line, &prior.pose);
                push_numbers(&mut line, prior.information.upper());
            }
            Touch::PositionNormal { .. } => {
                return Err(IoError::Unsupported {
                    path: path.to_owned(),
                    element: format!("the contact of taxel {id}"),
                    feature: "a normal".into(),
                    remedy: "write the contacts to a table of their own".into(),
                });
            }
        }
        emit(&mut line)?;
    }
    Ok(())
}

fn push(line: &mut String, text: std::fmt::Arguments<'_>) {
    line.write_fmt(text).expect("writing into a string cannot fail");
}

/// The shortest digits that read back to the same bits: at most 17.
fn push_numbers(line: &mut String, numbers: impl IntoIterator<Item = f64>) {
    for x in numbers {
        // Without an exponent 1e-300 would be 300 zeros.
        let plain = x == 0.0 || (1e-5..1e17).contains(&x.abs());
        if plain { push(line, format_args!(" {x}")) } else { push(line, format_args!(" {x:e}")) }
    }
}

fn push_pose(line: &mut String, pose: &Pose) {
    push_numbers(line, pose.position.to_array());
    push_numbers(line, pose.rotation.to_array());
}
