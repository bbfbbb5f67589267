//! g2o text (kummerle2011): one vertex, edge or parameter a line.

use std::collections::HashMap;
use std::fmt;
use std::io::{BufRead, Write};
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use glam::DVec3;

use crate::calib::{
    ContactMeasurement, DisplacementMeasurement, Information, Model, Observations, Pose, PoseMeasurement,
};
use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{LineLocation, Lines, cannot_write, unfit};
use crate::io::observations::builder::{ObservationsBuilder, ReadObservations};
use crate::io::table::writer::push_decimal;
use crate::skin::TaxelId;

/// The number g2o files give to the one offset that is written here.
const IDENTITY_OFFSET: u32 = 0;

/// Reads from the line on which `lines` stands.
pub(super) fn read(mut lines: Lines<impl BufRead>) -> Result<ReadObservations> {
    let mut reader = G2oReader { builder: ObservationsBuilder::new(lines.path()), offsets: HashMap::new() };
    while let Some((text, at)) = lines.current()? {
        let mut words = text.split_ascii_whitespace();
        if let Some(tag) = words.next() {
            reader.line(Line { tag, words, at })?;
        }
        lines.advance()?;
    }
    reader.builder.finish()
}

struct G2oReader {
    builder: ObservationsBuilder,
    /// The parameters: where sensors are in the frames of taxels.
    offsets: HashMap<u32, Pose>,
}

impl G2oReader {
    fn line(&mut self, mut line: Line<'_>) -> Result<()> {
        let at = line.at;
        match line.tag {
            "VERTEX_TRACKXYZ" => {
                let id = line.id()?;
                self.builder.set_model(Model::Positions, &at)?;
                self.builder.taxel(id, Pose::at(DVec3::from_array(line.numbers()?)), &at)
            }
            "VERTEX_SE3:QUAT" => {
                let id = line.id()?;
                self.builder.set_model(Model::Poses, &at)?;
                let pose = self.builder.pose(&line.numbers::<7>()?, &at)?;
                self.builder.taxel(id, pose, &at)
            }
            "EDGE_POINTXYZ" => {
                let ids = [line.id()?, line.id()?];
                self.builder.set_model(Model::Positions, &at)?;
                let (offset, information) = line.point()?;
                self.builder.edge(ids, DisplacementMeasurement::Offset { offset, information }, &at)
            }
            "EDGE_SE3:QUAT" => {
                let ids = [line.id()?, line.id()?];
                self.builder.set_model(Model::Poses, &at)?;
                let motion = self.measured_pose(&mut line)?;
                self.builder.edge(ids, DisplacementMeasurement::Relative(motion), &at)
            }
            "EDGE_POINTXYZ_PRIOR" => {
                let id = line.id()?;
                let (position, information) = line.point()?;
                self.builder.contact(id, ContactMeasurement::Position { position, information }, &at)
            }
            "EDGE_SE3_PRIOR" => {
                let (id, parameter) = (line.id()?, line.id()?.0);
                self.builder.set_model(Model::Poses, &at)?;
                let seen = self.measured_pose(&mut line)?;
                let needed = "the number of a PARAMS_SE3OFFSET line before this one";
                let offset = self.offsets.get(&parameter).copied();
                let offset = offset.ok_or_else(|| at.invalid(format!("parameter {parameter}"), needed))?;
                self.builder.contact(id, ContactMeasurement::Pose { offset, seen }, &at)
            }
            "PARAMS_SE3OFFSET" => {
                let parameter = line.id()?.0;
                let pose = self.builder.pose(&line.numbers::<7>()?, &at)?;
                let again = || format!("parameter {parameter} a second time");
                match self.offsets.insert(parameter, pose) {
                    Some(_) => Err(at.invalid(again(), "every parameter declared once")),
                    None => Ok(()),
                }
            }
            "FIX" => {
                self.builder.fix(line.id()?, &at);
                line.words.try_for_each(|word| at.taxel(word).map(|id| self.builder.fix(id, &at)))
            }
            tag => {
                self.builder.unknown_tag(tag);
                Ok(())
            }
        }
    }

    /// A pose and its information: the rest of a line.
    fn measured_pose(&mut self, line: &mut Line<'_>) -> Result<Box<PoseMeasurement>> {
        let numbers: [f64; 28] = line.numbers()?;
        let pose = self.builder.pose(&numbers[..7], &line.at)?;
        Ok(Box::new(PoseMeasurement { pose, information: line.information(&numbers[7..])? }))
    }
}

/// What is left of a line after its first word.
struct Line<'w> {
    tag: &'w str,
    words: SplitAsciiWhitespace<'w>,
    at: LineLocation<'w>,
}

impl Line<'_> {
    fn truncated(&self) -> IoError {
        let found = format!("a {} line that ends too soon", self.tag);
        self.at.invalid(found, "the numbers of taxels, then the values")
    }

    /// The number of a taxel, or of a parameter.
    fn id(&mut self) -> Result<TaxelId> {
        let word = self.words.next().ok_or_else(|| self.truncated())?;
        self.at.taxel(word)
    }

    /// The remaining words, which are this many finite numbers.
    fn numbers<const N: usize>(&mut self) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        let mut count = 0;
        for word in self.words.by_ref() {
            let number = self.at.number(word)?;
            if let Some(place) = numbers.get_mut(count) {
                *place = number;
            }
            count += 1;
        }
        if count == N {
            return Ok(numbers);
        }
        Err(self.at.invalid(format!("{count} numbers after the ids of {}", self.tag), N.to_string()))
    }

    fn point(&mut self) -> Result<(DVec3, Information<3>)> {
        let numbers: [f64; 9] = self.numbers()?;
        Ok((DVec3::from_slice(&numbers), self.information(&numbers[3..])?))
    }

    fn information<const N: usize>(&self, upper: &[f64]) -> Result<Information<N>> {
        Information::from_upper(upper).ok_or_else(|| self.truncated())
    }
}

/// Writes parameters, taxels, those that are fixed, edges and contacts, in this order.
pub(super) fn write(out: &mut dyn Write, observations: &Observations, path: &Path) -> Result<()> {
    let Observations { model, taxels, edges, contacts, .. } = observations;
    let mut text = Vec::new();
    let mut line = |words: fmt::Arguments<'_>, numbers: &[f64]| {
        text.clear();
        for &x in numbers {
            text.push(b' ');
            push_decimal(&mut text, x, 1e-5);
            text.pop();
        }
        text.push(b'\n');
        write!(out, "{words}").and_then(|()| out.write_all(&text)).map_err(cannot_write(path))
    };
    let (offsets, numbers) = offsets(observations);
    if contacts.iter().any(|c| matches!(c.measurement, ContactMeasurement::Pose { .. })) {
        for (k, offset) in (IDENTITY_OFFSET..).zip(&offsets) {
            line(format_args!("PARAMS_SE3OFFSET {k}"), &pose(offset))?;
        }
    }
    for taxel in taxels {
        let Some(initial) = taxel.initial else {
            let element = format!("taxel {}", taxel.id);
            return Err(unfit(
                path,
                element,
                "no initial pose",
                "an initial pose of every taxel, or a table",
            ));
        };
        match model {
            Model::Positions => {
                line(format_args!("VERTEX_TRACKXYZ {}", taxel.id), &initial.position.to_array())?
            }
            Model::Poses => line(format_args!("VERTEX_SE3:QUAT {}", taxel.id), &pose(&initial))?,
        }
    }
    for taxel in taxels.iter().filter(|t| t.fixed) {
        line(format_args!("FIX {}", taxel.id), &[])?;
    }
    for edge in edges {
        let (from, to) = (taxels[edge.from].id, taxels[edge.to].id);
        match &edge.measurement {
            DisplacementMeasurement::Offset { offset, information } => {
                line(format_args!("EDGE_POINTXYZ {from} {to}"), &informed(offset.to_array(), information))?
            }
            DisplacementMeasurement::Relative(m) => {
                line(format_args!("EDGE_SE3:QUAT {from} {to}"), &informed(pose(&m.pose), &m.information))?
            }
        }
    }
    for contact in contacts {
        let id = taxels[contact.taxel].id;
        match &contact.measurement {
            ContactMeasurement::Position { position, information } => {
                let numbers = informed(position.to_array(), information);
                line(format_args!("EDGE_POINTXYZ_PRIOR {id}"), &numbers)?;
            }
            ContactMeasurement::Pose { offset, seen } => {
                let k = numbers[&bits(offset)];
                let numbers = informed(pose(&seen.pose), &seen.information);
                line(format_args!("EDGE_SE3_PRIOR {id} {k}"), &numbers)?;
            }
            ContactMeasurement::PositionNormal { .. } => {
                let needed = "a position alone, or a table of contacts";
                return Err(unfit(path, format!("the contact of taxel {id}"), "a normal", needed));
            }
        }
    }
    Ok(())
}

/// Where sensors are in the frames of taxels: each pose once, the taxel's own first; and the number of each.
fn offsets(observations: &Observations) -> (Vec<Pose>, HashMap<[u64; 7], usize>) {
    let mut offsets = vec![Pose::default()];
    let mut numbers = HashMap::from([(bits(&offsets[0]), 0)]);
    for contact in &observations.contacts {
        if let ContactMeasurement::Pose { offset, .. } = &contact.measurement {
            numbers.entry(bits(offset)).or_insert_with(|| {
                offsets.push(*offset);
                offsets.len() - 1
            });
        }
    }
    (offsets, numbers)
}

/// A pose as a key; -0 is 0.
fn bits(offset: &Pose) -> [u64; 7] {
    pose(offset).map(|x| (x + 0.0).to_bits())
}

fn pose(pose: &Pose) -> [f64; 7] {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.position.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw]
}

fn informed<const N: usize>(of: impl IntoIterator<Item = f64>, information: &Information<N>) -> Vec<f64> {
    of.into_iter().chain(information.upper()).collect()
}
