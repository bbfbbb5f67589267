//! The elements of an MJCF model: included files in place, default classes, the settings of `<compiler>`.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};
use roxmltree::Node;

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::xml::{Xml, listed_numbers};
use crate::io::file::{Source, excerpt, invalid};

/// Attributes by name.
type Attributes = BTreeMap<String, String>;

/// The attributes that a class gives to the elements of each tag.
type Class = BTreeMap<String, Attributes>;

struct Markup {
    tag: String,
    attributes: Attributes,
    children: Vec<usize>,
    file: usize,
    line: usize,
}

pub(super) struct Model {
    elements: Vec<Markup>,
    files: Vec<PathBuf>,
    classes: BTreeMap<String, Class>,
    /// The class of elements without one.
    main: String,
    /// An angle of the file in rad.
    pub(super) angle: f64,
    pub(super) has_auto_limits: bool,
    euler: String,
    meshes: PathBuf,
    has_plain_names: bool,
}

/// An element with the class that applies to it.
#[derive(Clone)]
pub(super) struct View<'m> {
    model: &'m Model,
    element: &'m Markup,
    /// That of the bodies and frames around it.
    class: &'m str,
}

impl Model {
    pub(super) fn read(source: &Source) -> Result<Self> {
        let mut model = Self {
            elements: Vec::new(),
            files: vec![source.path().into()],
            classes: BTreeMap::new(),
            main: "main".to_owned(),
            angle: 1_f64.to_radians(),
            has_auto_limits: true,
            euler: "xyz".to_owned(),
            meshes: PathBuf::new(),
            has_plain_names: false,
        };
        let xml = Xml::parse(source)?;
        model.add_elements(&xml, 0, None);
        let mut known = HashSet::new();
        // Those of an included file come after all others.
        let mut next = 0;
        while next < model.elements.len() {
            model.include(source, next, &mut known)?;
            next += 1;
        }
        model.read_classes()?;
        model.read_settings()?;
        Ok(model)
    }

    /// Adds the elements of a file: its root, or only what is in it, at the end of the children of `place`.
    fn add_elements(&mut self, xml: &Xml<'_>, file: usize, place: Option<usize>) -> Vec<usize> {
        let mut open: Vec<(Node<'_, '_>, Option<usize>)> = vec![(xml.root(), None)];
        if place.is_some() {
            open = xml.root().children().filter(Node::is_element).map(|node| (node, None)).collect();
            open.reverse();
        }
        let mut roots = Vec::new();
        while let Some((node, parent)) = open.pop() {
            let own = self.elements.len();
            let attributes =
                node.attributes().map(|a| (a.name().to_owned(), a.value().trim().to_owned())).collect();
            let tag = node.tag_name().name().to_owned();
            self.elements.push(Markup { tag, attributes, children: Vec::new(), file, line: xml.line(node) });
            match parent {
                Some(parent) => self.elements[parent].children.push(own),
                None => roots.push(own),
            }
            let children: Vec<_> = node.children().filter(Node::is_element).collect();
            open.extend(children.into_iter().rev().map(|child| (child, Some(own))));
        }
        roots
    }

    /// Replaces the `<include>` elements in an element by what is in their files.
    fn include(&mut self, source: &Source, parent: usize, known: &mut HashSet<PathBuf>) -> Result<()> {
        let mut at = 0;
        while let Some(&child) = self.elements[parent].children.get(at) {
            at += 1;
            if self.elements[child].tag != "include" {
                continue;
            }
            let view = self.view(child);
            let name = view.attribute("file").ok_or_else(|| view.invalid("none", "an attribute file"))?;
            if !source.is_file() {
                return Err(view.invalid("another file", "a model in one file: these bytes are in no folder"));
            }
            let folders =
                [0, view.element.file].map(|file| self.files[file].parent().unwrap_or(Path::new("")));
            let paths = folders.map(|folder| folder.join(name));
            let path = paths.iter().find(|path| path.is_file()).unwrap_or(&paths[0]).clone();
            if !known.insert(path.clone()) {
                return Err(view.invalid(format!("{} again", path.display()), "each file included once"));
            }
            let included = Source::open(&path)?;
            let xml = Xml::parse(&included)?;
            self.files.push(path);
            let children = self.add_elements(&xml, self.files.len() - 1, Some(child));
            at -= 1;
            self.elements[parent].children.splice(at..=at, children);
        }
        Ok(())
    }

    /// The default classes: each begins as the one around it.
    fn read_classes(&mut self) -> Result<()> {
        let mut classes: BTreeMap<String, Class> = BTreeMap::new();
        let mut main = None;
        let tops = self.sections("default").map(|view| (view, None));
        let mut open: Vec<(View<'_>, Option<String>)> = tops.collect();
        open.reverse();
        while let Some((view, above)) = open.pop() {
            let name = match (view.attribute("class"), &above) {
                (Some(name), _) => name.to_owned(),
                (None, None) => main.clone().unwrap_or_else(|| "main".to_owned()),
                (None, Some(_)) => return Err(view.invalid("no class", "the name of a class")),
            };
            if above.is_none() && main.is_none() {
                main = Some(name.clone());
            }
            let start = above.as_ref().or(main.as_ref()).and_then(|above| classes.get(above));
            let mut class = classes.get(&name).or(start).cloned().unwrap_or_default();
            for part in view.children().filter(|part| part.tag() != "default") {
                class.entry(part.tag().to_owned()).or_default().extend(part.element.attributes.clone());
            }
            classes.insert(name.clone(), class);
            let inner: Vec<_> = view.children().filter(|part| part.tag() == "default").collect();
            open.extend(inner.into_iter().rev().map(|part| (part, Some(name.clone()))));
        }
        self.classes = classes;
        self.main = main.unwrap_or_else(|| "main".to_owned());
        Ok(())
    }

    fn read_settings(&mut self) -> Result<()> {
        let mut all = Attributes::new();
        for view in self.sections("compiler") {
            if view.attribute("coordinate").is_some_and(|value| value != "local") {
                return Err(
                    view.invalid("global coordinates", "local ones: save the model with MuJoCo 2.3.3")
                );
            }
            if let Some(sequence) = view.attribute("eulerseq")
                && (sequence.len() != 3 || !sequence.chars().all(|c| "xyzXYZ".contains(c)))
            {
                return Err(
                    view.invalid(format!("eulerseq={}", excerpt(sequence)), "three of x, y, z, X, Y, Z")
                );
            }
            all.extend(view.element.attributes.clone());
        }
        let get = |name: &str| all.get(name).map(String::as_str);
        self.angle = if get("angle") == Some("radian") { 1.0 } else { self.angle };
        self.has_auto_limits = get("autolimits") != Some("false");
        self.has_plain_names = get("strippath") == Some("true");
        self.euler = get("eulerseq").unwrap_or("xyz").to_owned();
        self.meshes = get("meshdir").or(get("assetdir")).unwrap_or_default().into();
        Ok(())
    }

    fn view(&self, element: usize) -> View<'_> {
        View { model: self, element: &self.elements[element], class: &self.main }
    }

    pub(super) fn root(&self) -> View<'_> {
        self.view(0)
    }

    /// The sections of a name, in the order of the file.
    pub(super) fn sections<'m>(&'m self, tag: &'static str) -> impl Iterator<Item = View<'m>> {
        self.elements[0].children.iter().map(|&k| self.view(k)).filter(move |view| view.tag() == tag)
    }

    /// What is in a body, with the frame that it is in.
    pub(super) fn members<'m>(&'m self, body: &View<'m>) -> Result<Vec<(View<'m>, DAffine3)>> {
        let reversed = |view: &View<'m>, frame: DAffine3| {
            let all: Vec<_> = view.children().map(|child| (child, frame)).collect();
            all.into_iter().rev()
        };
        let mut members = Vec::new();
        let mut open: Vec<_> = reversed(body, DAffine3::IDENTITY).collect();
        while let Some((view, frame)) = open.pop() {
            if view.tag() == "frame" {
                open.extend(reversed(&view, frame * self.pose(&view)?));
            } else {
                members.push((view, frame));
            }
        }
        Ok(members)
    }

    /// The file of a mesh, from the folder of the model.
    pub(super) fn mesh_file(&self, file: &str) -> String {
        let name = if self.has_plain_names { Path::new(file).file_name() } else { None };
        let file = name.map_or_else(|| PathBuf::from(file), PathBuf::from);
        self.meshes.join(file).to_string_lossy().into_owned()
    }

    /// The pose that `pos` and one of the five attributes of orientation give.
    pub(super) fn pose(&self, view: &View<'_>) -> Result<DAffine3> {
        let position = view.numbers("pos")?.map_or(DVec3::ZERO, DVec3::from_array);
        let direction =
            |v: DVec3| v.try_normalize().ok_or_else(|| view.invalid("a direction 0 0 0", "a direction"));
        let turn = if let Some([x, y, z, angle]) = view.numbers("axisangle")? {
            DMat3::from_axis_angle(direction(DVec3::new(x, y, z))?, angle * self.angle)
        } else if let Some(axes) = view.numbers::<6>("xyaxes")? {
            let x = direction(DVec3::from_slice(&axes))?;
            let y = DVec3::from_slice(&axes[3..]);
            let y = direction(y - x * x.dot(y))?;
            DMat3::from_cols(x, y, x.cross(y))
        } else if let Some(z) = view.numbers("zaxis")? {
            arc(direction(DVec3::from_array(z))?)
        } else if let Some(angles) = view.numbers::<3>("euler")? {
            let mut turn = DMat3::IDENTITY;
            for (axis, angle) in self.euler.chars().zip(angles.map(|x| x * self.angle)) {
                let own = match axis.to_ascii_lowercase() {
                    'x' => DMat3::from_rotation_x(angle),
                    'y' => DMat3::from_rotation_y(angle),
                    _ => DMat3::from_rotation_z(angle),
                };
                turn = if axis.is_ascii_lowercase() { turn * own } else { own * turn };
            }
            turn
        } else {
            view.numbers("quat")?.map_or(DMat3::IDENTITY, quaternion)
        };
        Ok(DAffine3::from_mat3_translation(turn, position))
    }
}

/// The turn of a quaternion `w x y z`; that of 0 is none.
pub(super) fn quaternion([w, x, y, z]: [f64; 4]) -> DMat3 {
    let length = DQuat::from_xyzw(x, y, z, w).length();
    if length > 0.0 { DMat3::from_quat(DQuat::from_xyzw(x, y, z, w) / length) } else { DMat3::IDENTITY }
}

/// The smallest turn of z into a direction.
pub(super) fn arc(direction: DVec3) -> DMat3 {
    let axis = DVec3::Z.cross(direction);
    let axis_or_x = axis.try_normalize().unwrap_or(DVec3::X);
    DMat3::from_axis_angle(axis_or_x, axis.length().atan2(direction.z))
}

impl<'m> View<'m> {
    pub(super) fn tag(&self) -> &'m str {
        &self.element.tag
    }

    pub(super) fn line(&self) -> usize {
        self.element.line
    }

    /// An attribute of the element itself.
    pub(super) fn attribute(&self, name: &str) -> Option<&'m str> {
        self.element.attributes.get(name).map(String::as_str)
    }

    /// An attribute of the element or its class.
    pub(super) fn get(&self, name: &str) -> Option<&'m str> {
        let class = || {
            let class = self.model.classes.get(self.attribute("class").unwrap_or(self.class))?;
            class.get(self.tag())?.get(name).map(String::as_str)
        };
        self.attribute(name).or_else(class)
    }

    /// The elements in it.
    pub(super) fn children(&self) -> impl DoubleEndedIterator<Item = View<'m>> {
        let (model, class) = (self.model, self.attribute("childclass").unwrap_or(self.class));
        self.element.children.iter().map(move |&k| View { model, element: &model.elements[k], class })
    }

    pub(super) fn list(&self, name: &str) -> Result<Vec<f64>> {
        let text = self.get(name).unwrap_or_default();
        listed_numbers(text)
            .ok_or_else(|| self.invalid(format!("{name}={}", excerpt(text)), "finite numbers"))
    }

    /// The first numbers of an attribute, if that is there.
    pub(super) fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let numbers = self.list(name)?.try_into();
        numbers
            .map(Some)
            .map_err(|_| self.invalid(format!("{name}={}", excerpt(text)), format!("{N} finite numbers")))
    }

    pub(super) fn number(&self, name: &str) -> Result<Option<f64>> {
        Ok(self.numbers(name)?.map(|[x]| x))
    }

    pub(super) fn invalid(&self, found: impl Into<String>, needed: impl Into<String>) -> IoError {
        let name = self.attribute("name").map(|name| format!(" name={}", excerpt(name))).unwrap_or_default();
        let element = (self.line(), format!("<{}{name}>", self.tag()));
        invalid(&self.model.files[self.element.file], element, found, needed)
    }
}
