//! XML: the elements of a file, and where in it they stand.

use std::borrow::Cow;
use std::collections::HashMap;

use roxmltree::{Document, Node, ParsingOptions};

use crate::io::IoError;
use crate::io::error::Result;
use crate::io::file::{Source, excerpt, finite};

/// More elements and texts are refused; a robot of 100,000 links has some millions.
const MOST_NODES: u32 = 1 << 23;

/// Largest file that is read, in bytes: its elements take several times as much memory.
const MOST_BYTES: usize = 1 << 30;

/// The elements of a file. Entities of its own are refused, and with them those that grow without end.
pub(crate) struct Xml<'a> {
    pub(crate) source: &'a Source,
    document: Document<'a>,
    /// Where each line ends, in bytes.
    ends: Vec<usize>,
}

impl<'a> Xml<'a> {
    pub(crate) fn parse(source: &'a Source) -> Result<Self> {
        let text = source.xml_text()?;
        if text.len() > MOST_BYTES {
            let needed = format!("at most {MOST_BYTES} bytes of XML");
            return Err(source.invalid("file", format!("{} bytes", text.len()), needed));
        }
        let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options)
            .map_err(|e| source.invalid((e.pos().row, ""), e.to_string(), "well-formed XML without a DTD"))?;
        let ends = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n').map(|(at, _)| at).collect();
        Ok(Self { source, document, ends })
    }

    pub(crate) fn root(&self) -> Node<'_, 'a> {
        self.document.root_element()
    }

    /// The line of an element, counted from 1.
    pub(crate) fn line(&self, node: Node<'_, '_>) -> usize {
        1 + self.ends.partition_point(|&end| end < node.range().start)
    }

    pub(crate) fn invalid(
        &self,
        node: Node<'_, '_>,
        found: impl Into<String>,
        needed: impl Into<String>,
    ) -> IoError {
        self.source.invalid((self.line(node), tag(node)), found, needed)
    }

    /// The text of an attribute that must be there.
    pub(crate) fn need<'b>(&self, node: Node<'b, 'a>, attribute: &str) -> Result<&'b str> {
        let needed = || format!("an attribute {attribute}");
        node.attribute(attribute).ok_or_else(|| self.invalid(node, "none", needed()))
    }

    /// A child that must be there.
    pub(crate) fn need_child<'b>(&self, node: Node<'b, 'a>, name: &str) -> Result<Node<'b, 'a>> {
        child(node, name).ok_or_else(|| self.invalid(node, "none", format!("an element <{name}> in it")))
    }

    /// The number of an attribute, if that is there.
    pub(crate) fn number(&self, node: Node<'_, 'a>, attribute: &str) -> Result<Option<f64>> {
        Ok(self.numbers(node, attribute)?.map(|[x]| x))
    }

    /// The numbers of an attribute, if that is there.
    pub(crate) fn numbers<const N: usize>(
        &self,
        node: Node<'_, 'a>,
        attribute: &str,
    ) -> Result<Option<[f64; N]>> {
        let Some(text) = node.attribute(attribute) else { return Ok(None) };
        let numbers = listed_numbers(text).and_then(|numbers| numbers.try_into().ok());
        let many = if N == 1 { "a finite number" } else { "finite numbers" };
        let refuse = || {
            let needed = if N == 1 { many.to_owned() } else { format!("{N} {many}") };
            self.invalid(node, format!("{attribute}={}", excerpt(text)), needed)
        };
        numbers.map(Some).ok_or_else(refuse)
    }
}

/// The finite numbers of an attribute. White space separates them, also after a comma, as Bullet reads them.
pub(crate) fn listed_numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|word| finite(word.strip_suffix(',').unwrap_or(word))).collect()
}

/// The text of an element, all pieces of it: a comment may stand between them.
pub(crate) fn text_of<'a>(node: Node<'a, '_>) -> Cow<'a, str> {
    let mut pieces = node.children().filter(Node::is_text).filter_map(|piece| piece.text());
    let first = Cow::Borrowed(pieces.next().unwrap_or_default());
    // A comment separates words.
    pieces.fold(first, |all, piece| all + " " + piece)
}

/// The first child of a name.
pub(crate) fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|child| child.is_element() && child.tag_name().name() == name)
}

/// The children of a name. Names are compared without their namespaces.
pub(crate) fn children<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == name)
}

/// An element as errors call it: its tag, with its name or id.
fn tag(node: Node<'_, '_>) -> String {
    let known = ["name", "id", "link", "idx"].into_iter().find_map(|key| Some((key, node.attribute(key)?)));
    let name = node.tag_name().name();
    known.map_or_else(|| format!("<{name}>"), |(key, value)| format!("<{name} {key}={}>", excerpt(value)))
}

/// Elements with names of their own.
pub(crate) struct Named<'a, 'i> {
    pub(crate) nodes: Vec<Node<'a, 'i>>,
    pub(crate) names: Vec<&'a str>,
    places: HashMap<&'a str, usize>,
}

impl<'a, 'i> Named<'a, 'i> {
    pub(crate) fn read(xml: &Xml<'i>, nodes: impl Iterator<Item = Node<'a, 'i>>) -> Result<Self> {
        let mut named = Self { nodes: Vec::new(), names: Vec::new(), places: HashMap::new() };
        for node in nodes {
            let name = xml.need(node, "name")?;
            if let Some(earlier) = named.places.insert(name, named.nodes.len()) {
                let found = format!("the name of line {} again", xml.line(named.nodes[earlier]));
                return Err(xml.invalid(node, found, "a name of its own"));
            }
            named.nodes.push(node);
            named.names.push(name);
        }
        Ok(named)
    }

    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }
}
