//! 3MF (`.3mf`): the triangles of its build, a zip archive of XML.

use std::collections::HashMap;
use std::io::{Cursor, Read};
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use roxmltree::Node;
use zip::ZipArchive;

use crate::io::error::Result;
use crate::io::file::xml::{Xml, child, children, listed_numbers};
use crate::io::file::{Source, excerpt};
use crate::skin::{Draft, Sheet};

/// Most bytes of all parts that are read, unpacked.
const MOST_BYTES: u64 = 1 << 30;

/// Objects in objects.
const DEEPEST: usize = 100;

/// Most triangles, and most uses of objects: objects that use others multiply without end.
const MOST_TRIANGLES: usize = 50_000_000;
const MAX_USES: usize = 1_000_000;

/// Where the model is if no relationship names it.
const MODEL: &str = "3D/3dmodel.model";

/// Reads a 3MF file (core specification 1.3): every object that its build uses becomes a sheet, in m by the unit of the model;
/// objects of support are left out. Objects may be in other parts of the file, as the production extension has them.
pub(crate) fn read(source: &Source) -> Result<Draft> {
    let parts = parts(source)?;
    let xmls: Vec<(&str, Xml<'_>)> =
        parts.iter().map(|(name, part)| Ok((&**name, Xml::parse(part)?))).collect::<Result<_>>()?;
    let start = xmls.iter().find(|(_, xml)| {
        child(xml.root(), "build").is_some_and(|build| children(build, "item").next().is_some())
    });
    let Some((start, xml)) = start else {
        return Err(source.invalid("file", "no part with a <build> of items", "a model to be built"));
    };
    let mut scene = Scene { objects: HashMap::new(), sheets: Vec::new(), triangles: 0, uses: 0 };
    for (name, xml) in &xmls {
        let objects = child(xml.root(), "resources").into_iter().flat_map(|all| children(all, "object"));
        for object in objects {
            scene.objects.insert((*name, xml.need(object, "id")?), (xml, object));
        }
    }
    let build = xml.need_child(xml.root(), "build")?;
    for item in children(build, "item") {
        scene.add(start, xml, item, DAffine3::from_scale(DVec3::splat(metres(xml)?)), 0)?;
    }
    Ok(Draft { sheets: scene.sheets, ..Draft::default() })
}

/// The models of an archive, by their names, that where the model begins first.
fn parts(source: &Source) -> Result<Vec<(String, Source)>> {
    let broken = |error: &dyn std::fmt::Display| {
        source.invalid("file", error.to_string(), "a .3mf: a whole zip archive of models in XML")
    };
    let mut archive = ZipArchive::new(Cursor::new(source.bytes())).map_err(|e| broken(&e))?;
    let mut names: Vec<String> =
        archive.file_names().filter(|n| n.ends_with(".model")).map(str::to_owned).collect();
    names.sort_by_key(|name| (name != MODEL, name.clone()));
    let mut left = MOST_BYTES;
    let mut parts = Vec::new();
    for name in names {
        let entry = archive.by_name(&name).map_err(|e| broken(&e))?;
        let mut bytes = Vec::new();
        entry.take(left + 1).read_to_end(&mut bytes).map_err(|e| broken(&e))?;
        left = left.checked_sub(bytes.len() as u64).ok_or_else(|| {
            source.invalid(name.clone(), "more bytes", format!("at most {MOST_BYTES} bytes of models"))
        })?;
        let path = source.path().join(Path::new(&name));
        parts.push((name, Source::from_bytes(&path, bytes)?));
    }
    Ok(parts)
}

/// The unit of length of a model, in m.
fn metres(xml: &Xml<'_>) -> Result<f64> {
    let unit = xml.root().attribute("unit").unwrap_or("millimeter");
    Ok(match unit {
        "micron" => 1e-6,
        "millimeter" => 1e-3,
        "centimeter" => 1e-2,
        "inch" => 0.0254,
        "foot" => 0.3048,
        "meter" => 1.0,
        _ => {
            let needed = "micron, millimeter, centimeter, inch, foot or meter";
            return Err(xml.invalid(xml.root(), format!("unit={}", excerpt(unit)), needed));
        }
    })
}

struct Scene<'a, 'i> {
    /// By the part that they are in, and their id.
    objects: HashMap<(&'a str, &'a str), (&'a Xml<'i>, Node<'a, 'i>)>,
    sheets: Vec<Sheet>,
    triangles: usize,
    uses: usize,
}

impl<'a, 'i> Scene<'a, 'i> {
    /// Adds the object that an item of the build or a component of another object names.
    fn add(
        &mut self,
        part: &'a str,
        xml: &'a Xml<'i>,
        user: Node<'a, 'i>,
        pose: DAffine3,
        depth: usize,
    ) -> Result<()> {
        self.uses += 1;
        if depth > DEEPEST || self.uses > MAX_USES {
            let needed = format!("at most {DEEPEST} objects in each other, and {MAX_USES} uses in all");
            return Err(xml.invalid(user, "more objects, or objects that use themselves", needed));
        }
        let path = user.attributes().find(|attribute| attribute.name() == "path");
        let part = path.map_or(part, |path| path.value().trim_start_matches('/'));
        let id = xml.need(user, "objectid")?;
        let unknown = || xml.invalid(user, format!("objectid={}", excerpt(id)), "the id of an <object>");
        let &(xml_there, object) = self.objects.get(&(part, id)).ok_or_else(unknown)?;
        if matches!(object.attribute("type"), Some("support" | "solidsupport")) {
            return Ok(());
        }
        let pose = pose * transform(xml, user)?;
        for component in child(object, "components").into_iter().flat_map(|all| children(all, "component")) {
            self.add(part, xml_there, component, pose, depth + 1)?;
        }
        match child(object, "mesh") {
            Some(mesh) => self.add_mesh(xml_there, object, mesh, pose),
            None => Ok(()),
        }
    }

    fn add_mesh(
        &mut self,
        xml: &Xml<'i>,
        object: Node<'a, 'i>,
        mesh: Node<'a, 'i>,
        pose: DAffine3,
    ) -> Result<()> {
        let mut positions = Vec::new();
        for vertex in children(xml.need_child(mesh, "vertices")?, "vertex") {
            let axis = |name: &str| -> Result<f64> {
                xml.number(vertex, name)?.ok_or_else(|| xml.invalid(vertex, "none", name))
            };
            let p = pose.transform_point3(DVec3::new(axis("x")?, axis("y")?, axis("z")?));
            if !p.is_finite() {
                return Err(xml.invalid(vertex, "a vertex beyond all numbers", "finite coordinates"));
            }
            positions.push(p);
        }
        let mut triangles = Vec::new();
        for triangle in children(xml.need_child(mesh, "triangles")?, "triangle") {
            let corner = |name| {
                let text = xml.need(triangle, name)?;
                let known = text.trim().parse::<u32>().ok().filter(|&v| (v as usize) < positions.len());
                let needed = || format!("one of {} vertices, counted from 0", positions.len());
                known.ok_or_else(|| xml.invalid(triangle, format!("{name}={}", excerpt(text)), needed()))
            };
            let [a, b, c] = [corner("v1")?, corner("v2")?, corner("v3")?];
            // A mirror turns the triangles over.
            triangles.push(if pose.matrix3.determinant() < 0.0 { [a, c, b] } else { [a, b, c] });
        }
        self.triangles += triangles.len();
        if self.triangles > MOST_TRIANGLES {
            let needed = format!("at most {MOST_TRIANGLES} triangles in all uses of objects");
            return Err(xml.invalid(mesh, "more triangles", needed));
        }
        let id = object.attribute("id").unwrap_or_default();
        let name = object.attribute("name").map_or_else(|| format!("object{id}"), str::to_owned);
        self.sheets.push(Sheet { name, positions, triangles, ..Sheet::default() });
        Ok(())
    }
}

/// The transform of an item or a component: four rows of three numbers, by which a row `x y z 1` is multiplied.
fn transform(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<DAffine3> {
    let Some(text) = node.attribute("transform") else { return Ok(DAffine3::IDENTITY) };
    let rows = listed_numbers(text).filter(|all| all.len() == 12);
    let rows =
        rows.ok_or_else(|| xml.invalid(node, format!("transform={}", excerpt(text)), "12 finite numbers"))?;
    let row = |k: usize| DVec3::from_slice(&rows[3 * k..]);
    Ok(DAffine3::from_mat3_translation(DMat3::from_cols(row(0), row(1), row(2)), row(3)))
}
