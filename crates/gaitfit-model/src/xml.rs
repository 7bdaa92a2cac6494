//! XML text to an owned element tree with byte positions; includes spliced in; sizes bounded.
//!
//! Robot files come from anywhere. Text, element count, depth and number of files are capped before
//! anything is built from them, so that no input exhausts memory or the stack.

use std::collections::HashSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{ModelError, Place};
use crate::scan::{self, MAX_NODES};
use crate::shown::{escaped, shown, shown_path};

// Places hold bytes as `u32`, so this must stay below 4 GiB.
/// Max number of bytes of all files together.
const MAX_BYTES: usize = 16 << 20;
/// Max number of files joined by `<include>`.
const MAX_FILES: usize = 64;

/// A byte of one of the files read; resolved to line and column only when a message needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub(crate) struct At {
    file: u32,
    byte: u32,
}

/// One attribute.
#[derive(Clone, Debug)]
pub(crate) struct Attribute {
    pub name: String,
    pub value: String,
    pub at: At,
}

/// One element; texts and comments are not kept.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub name: String,
    pub attributes: Vec<Attribute>,
    pub children: Vec<Element>,
    pub at: At,
}

impl Element {
    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|a| a.name == name).map(|a| a.value.as_str())
    }

    /// `<geom> "shell"`, or `<geom>` when it has no name.
    pub fn label(&self) -> String {
        match self.get("name") {
            Some(name) => format!("<{}> \"{}\"", shown(&self.name), shown(name)),
            None => format!("<{}>", shown(&self.name)),
        }
    }
}

/// In lines longer than this, columns count bytes: a hostile one-line file stays cheap.
const LONG_LINE: usize = 4096;

/// The texts read, kept for line numbers.
#[derive(Debug, Default)]
pub(crate) struct Sources {
    files: Vec<Source>,
    /// Folder of the main file; none for a text.
    pub folder: Option<PathBuf>,
}

#[derive(Debug)]
struct Source {
    name: String,
    text: String,
    /// First byte of every line.
    lines: Vec<usize>,
}

impl Sources {
    fn add(&mut self, name: String, text: String) {
        let breaks = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1);
        let lines = std::iter::once(0).chain(breaks).collect();
        self.files.push(Source { name, text, lines });
    }

    /// Line and column of a position.
    pub fn place(&self, at: At) -> Place {
        let Some(source) = self.files.get(at.file as usize) else {
            return Place { file: String::new(), line: 1, column: 1 };
        };
        let byte = at.byte as usize;
        // Lines begin at ascending bytes, so a binary search finds the line.
        let line = source.lines.partition_point(|start| *start <= byte);
        let start = source.lines.get(line.saturating_sub(1)).copied().unwrap_or(0);
        let before = source.text.get(start..byte).unwrap_or("");
        let column = if before.len() > LONG_LINE { before.len() } else { before.chars().count() };
        Place { file: source.name.clone(), line: line as u32, column: column as u32 + 1 }
    }
}

/// Reads the file at `path` and what it includes.
///
/// # Errors
/// [`ModelError::Io`], [`ModelError::Syntax`], [`ModelError::TooLarge`], [`ModelError::Invalid`] for a
/// cyclic or repeated include.
pub(crate) fn load(path: &Path, sources: &mut Sources) -> Result<Element, ModelError> {
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    sources.folder = Some(folder.clone());
    let mut loader =
        Loader { sources, base: Some(folder), seen: HashSet::new(), bytes: 0, nodes: 0, models: 0 };
    let text = loader.read(path)?;
    // No include may name the main file.
    loader.seen.insert(canonical(path));
    loader.parse(path.display().to_string(), text, 1)
}

/// Parses a text called `name` in messages; includes are refused because there is no folder to look in.
pub(crate) fn parse(name: &str, text: &str, sources: &mut Sources) -> Result<Element, ModelError> {
    let mut loader = Loader { sources, base: None, seen: HashSet::new(), bytes: 0, nodes: 0, models: 0 };
    loader.count(name, text.len())?;
    loader.parse(name.to_string(), text.to_string(), 1)
}

struct Loader<'a> {
    sources: &'a mut Sources,
    /// Folder of the main file: MuJoCo resolves every include against it.
    base: Option<PathBuf>,
    seen: HashSet<PathBuf>,
    bytes: usize,
    nodes: usize,
    /// Files named by `<model>`.
    models: usize,
}

impl Loader<'_> {
    fn count(&mut self, name: &str, bytes: usize) -> Result<(), ModelError> {
        self.bytes = self.bytes.saturating_add(bytes);
        if self.bytes > MAX_BYTES {
            return Err(ModelError::TooLarge {
                place: Place { file: name.to_string(), line: 1, column: 1 },
                message: format!("the robot's files exceed {} MiB", MAX_BYTES >> 20),
                remedy: "a robot description holds no meshes or data; remove what is not part of it".into(),
            });
        }
        Ok(())
    }

    fn read(&mut self, path: &Path) -> Result<String, ModelError> {
        let io = |source| ModelError::Io { path: path.to_path_buf(), source };
        // Asked before opening: a pipe without a writer would hang.
        if !std::fs::metadata(path).map_err(io)?.is_file() {
            return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, "not a regular file")));
        }
        let file = File::open(path).map_err(io)?;
        let mut bytes = Vec::new();
        // One byte more than may be, so that a file that is too large shows as such.
        file.take(MAX_BYTES as u64 + 1).read_to_end(&mut bytes).map_err(io)?;
        let name = path.display().to_string();
        self.count(&name, bytes.len())?;
        String::from_utf8(bytes).map_err(|error| {
            let valid = error.utf8_error().valid_up_to();
            let before = &error.as_bytes()[..valid];
            ModelError::Syntax {
                place: Place {
                    file: name,
                    line: before.iter().filter(|&&b| b == b'\n').count() as u32 + 1,
                    column: before.iter().rev().take_while(|&&b| b != b'\n').count() as u32 + 1,
                },
                message: "the file is not UTF-8 text".into(),
                remedy: "give an MJCF or URDF file saved as UTF-8".into(),
            }
        })
    }

    /// Parses one file whose root element stands at `depth` of the whole tree.
    fn parse(&mut self, name: String, text: String, depth: usize) -> Result<Element, ModelError> {
        let file = self.sources.files.len() as u32;
        self.sources.add(name.clone(), text.clone());
        scan::check(&text, depth, &mut self.nodes).map_err(|excess| ModelError::TooLarge {
            place: self.sources.place(At { file, byte: excess.byte as u32 }),
            message: excess.message,
            remedy: excess.remedy.into(),
        })?;
        // Between the nodes that were counted stand texts.
        let options =
            ParsingOptions { allow_dtd: false, nodes_limit: 2 * MAX_NODES as u32 + 8, ..Default::default() };
        let document = Document::parse_with_options(&text, options).map_err(|error| {
            let pos = error.pos();
            let is_toml = name.ends_with(".toml");
            let place = Place { file: name, line: pos.row, column: pos.col };
            if is_toml {
                return ModelError::Syntax {
                    place,
                    message: "this is TOML, and a robot's file is XML".into(),
                    remedy:
                        "give the MJCF or URDF file; the robot.toml of a simulated robot names it as `model`"
                            .into(),
                };
            }
            ModelError::Syntax {
                place,
                // The parser's own message may hold names of the file.
                message: format!("not well-formed XML: {}", escaped(&error.to_string(), 200)),
                remedy: "correct the XML at this place".into(),
            }
        })?;
        // xacro is well-formed XML, so the parser has nothing against it.
        if let Some(byte) = xacro(&document) {
            let place = self.sources.place(At { file, byte: byte as u32 });
            let remedy = xacro_remedy(&place.file);
            return Err(ModelError::Unsupported {
                place,
                message: "this is xacro, a template that makes a URDF, and not a URDF".into(),
                remedy,
            });
        }
        self.convert(document.root_element(), file, depth)
    }

    fn convert(&mut self, node: Node, file: u32, depth: usize) -> Result<Element, ModelError> {
        let at = At { file, byte: node.range().start as u32 };
        let attributes = node
            .attributes()
            .map(|a| Attribute {
                name: a.name().to_string(),
                value: a.value().to_string(),
                at: At { file, byte: a.range().start as u32 },
            })
            .collect();
        let name = node.tag_name().name().to_string();
        let mut element = Element { name, attributes, children: Vec::new(), at };
        for child in node.children().filter(Node::is_element) {
            if child.tag_name().name() == "include" {
                // The included root stands where the parent stands: its children join the parent's.
                element.children.extend(self.include(child, file, depth)?.children);
            } else {
                let mut inner = self.convert(child, file, depth + 1)?;
                if element.name == "asset" && inner.name == "model" {
                    inner.children.push(self.model(&inner)?);
                }
                element.children.push(inner);
            }
        }
        Ok(element)
    }

    /// The document that a `<model>` of the assets names.
    fn model(&mut self, element: &Element) -> Result<Element, ModelError> {
        let place = self.sources.place(element.at);
        let invalid = |message: String, remedy: &str| ModelError::Invalid {
            place: place.clone(),
            message,
            remedy: remedy.to_string(),
        };
        let Some(wanted) = element.get("file") else {
            return Err(invalid("<model> names no file".into(), "add file=\"...\""));
        };
        let Some(base) = self.base.clone() else {
            let remedy = "read the model from a file";
            return Err(invalid("<model> in a text without a folder".into(), remedy));
        };
        if self.models >= MAX_FILES {
            return Err(ModelError::TooLarge {
                place,
                message: format!("more than {MAX_FILES} files named by <model>, or one that names itself"),
                remedy: "merge them".into(),
            });
        }
        self.models += 1;
        let path = base.join(wanted);
        let text = self.read(&path).map_err(|error| match error {
            ModelError::Io { source, .. } => {
                invalid(format!("cannot read {}: {source}", shown_path(&path)), "correct the file name")
            }
            other => other,
        })?;
        // Its includes and models lie beside it, and it may include what this file includes.
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        let (base, seen) = (self.base.replace(folder), std::mem::take(&mut self.seen));
        let document = self.parse(path.display().to_string(), text, 1);
        (self.base, self.seen) = (base, seen);
        document
    }

    fn include(&mut self, node: Node, file: u32, depth: usize) -> Result<Element, ModelError> {
        let place = self.sources.place(At { file, byte: node.range().start as u32 });
        let invalid = |message: String, remedy: &str| ModelError::Invalid {
            place: place.clone(),
            message,
            remedy: remedy.to_string(),
        };
        if let Some(other) = node.attributes().find(|a| a.name() != "file") {
            return Err(invalid(
                format!("<include> has no attribute \"{}\"", shown(other.name())),
                "keep only `file`",
            ));
        }
        let Some(wanted) = node.attribute("file") else {
            return Err(invalid("<include> names no file".into(), "add file=\"...\""));
        };
        let Some(base) = &self.base else {
            return Err(invalid(
                "<include> in a text without a folder".into(),
                "read the model from a file, or paste the included elements",
            ));
        };
        if self.seen.len() >= MAX_FILES {
            return Err(ModelError::TooLarge {
                place,
                message: format!("more than {MAX_FILES} files joined by <include>"),
                remedy: "merge them".into(),
            });
        }
        let path = base.join(wanted);
        // The place of the <include> tells the user more than the name of a file that is not there.
        let text = self.read(&path).map_err(|error| match error {
            ModelError::Io { source, .. } => {
                invalid(format!("cannot include {}: {source}", shown_path(&path)), "correct the file name")
            }
            other => other,
        })?;
        // Canonical, so that another spelling of the same path is found too.
        if !self.seen.insert(canonical(&path)) {
            return Err(invalid(
                format!("{} is included twice, or includes itself", shown_path(&path)),
                "include every file once",
            ));
        }
        self.parse(path.display().to_string(), text, depth)
    }
}

/// One name for one file, so that `a/../x.xml` and `x.xml` are the same include.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
}

/// Where a file is seen to be xacro: an element or attribute of its namespace.
fn xacro(document: &Document) -> Option<usize> {
    let is_xacro = |namespace: Option<&str>| namespace.is_some_and(|name| name.contains("xacro"));
    let root = document.root_element();
    // The namespace alone is left over in URDFs that xacro made.
    let used = document.descendants().filter(Node::is_element).find(|node| {
        is_xacro(node.tag_name().namespace())
            || node.attributes().any(|attribute| is_xacro(attribute.namespace()))
    });
    let declared = root.namespaces().any(|namespace| is_xacro(Some(namespace.uri())));
    // `${` marks a template only where xacro is declared: any other text may hold it too.
    let filled = |node: &Node| node.attributes().any(|attribute| attribute.value().contains("${"));
    let template = || document.descendants().find(|node| declared && node.is_element() && filled(node));
    used.or_else(template).map(|node| node.range().start)
}

/// The command that makes a URDF of the xacro file `name`.
fn xacro_remedy(name: &str) -> String {
    let name = shown_path(Path::new(name));
    let stem = name.strip_suffix(".xacro").unwrap_or(&name);
    let made = match stem.strip_suffix(".urdf") {
        // A xacro file under a URDF's name.
        Some(stem) if name.ends_with(".urdf") => format!("{stem}.expanded.urdf"),
        Some(stem) => format!("{stem}.urdf"),
        None => format!("{stem}.urdf"),
    };
    format!("run xacro, a program of ROS: `xacro {name} > {made}`, and give {made}")
}
