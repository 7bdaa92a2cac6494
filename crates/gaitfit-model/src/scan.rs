//! Bounds on an XML text, checked before the parser sees it.
//!
//! The parser compares every attribute of a tag with every other, and copies the namespaces of a parent to each child
//! that declares one. [`check`] goes once over the text and refuses what would make that slow. It knows only where tags,
//! attributes, comments and such begin and end. Where a text is not well formed it stops, and the parser, which stops at
//! the same place, says why.

// The parser compares every two attributes of a tag: 100 of them are 4950 comparisons.
/// Max number of attributes of one tag, namespaces included.
pub(crate) const MAX_ATTRIBUTES: usize = 100;
/// Max number of namespaces declared in one file.
pub(crate) const MAX_NAMESPACES: usize = 128;
/// Max number of bytes of the name of a tag or an attribute.
pub(crate) const MAX_NAME: usize = 256;
// Readers call themselves once a level, so the depth must fit the stack.
/// Max depth of elements inside each other.
pub(crate) const MAX_DEPTH: usize = 100;
/// Max number of tags (opening and closing), comments and such of all files together.
pub(crate) const MAX_NODES: usize = 200_000;

/// What is too large, and where.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Excess {
    pub byte: usize,
    pub message: String,
    pub remedy: &'static str,
}

/// Checks a text whose root element stands at `depth` of the whole tree; `nodes` counts on over the files.
///
/// # Errors
/// The first place at which a bound is passed.
pub(crate) fn check(text: &str, depth: usize, nodes: &mut usize) -> Result<(), Excess> {
    check_up_to(text, depth, nodes, MAX_NODES)
}

/// Does what [`check`] does, for up to `max` nodes.
///
/// # Errors
/// As [`check`].
pub(crate) fn check_up_to(text: &str, depth: usize, nodes: &mut usize, max: usize) -> Result<(), Excess> {
    let mut scan = Scan { bytes: text.as_bytes(), at: 0, depth, namespaces: 0 };
    while let Some(start) = scan.find(b"<") {
        *nodes += 1;
        if *nodes > max {
            return excess(
                start,
                format!("more than {max} XML nodes"),
                "reduce the file to the robot's description",
            );
        }
        let closed = if scan.eat(b"!--") {
            scan.find(b"-->").is_some()
        } else if scan.eat(b"![CDATA[") {
            scan.find(b"]]>").is_some()
        } else if scan.eat(b"?") {
            scan.find(b"?>").is_some()
        } else if scan.eat(b"/") {
            // Saturating: a text with too many closing tags is not well formed.
            scan.depth = scan.depth.saturating_sub(1);
            scan.name()?;
            scan.find(b">").is_some()
        } else {
            scan.tag(start)?
        };
        if !closed {
            break;
        }
    }
    Ok(())
}

fn excess<T>(byte: usize, message: String, remedy: &'static str) -> Result<T, Excess> {
    Err(Excess { byte, message, remedy })
}

struct Scan<'t> {
    bytes: &'t [u8],
    /// Next byte to look at; never beyond the end.
    at: usize,
    /// Depth at which the next element stands.
    depth: usize,
    namespaces: usize,
}

impl Scan<'_> {
    /// Goes on behind the next `mark`; returns where it begins.
    fn find(&mut self, mark: &[u8]) -> Option<usize> {
        let distance = self.bytes[self.at..].windows(mark.len()).position(|window| window == mark)?;
        self.at += distance + mark.len();
        Some(self.at - mark.len())
    }

    /// Goes on behind `mark` if it comes next.
    fn eat(&mut self, mark: &[u8]) -> bool {
        let here = self.bytes[self.at..].starts_with(mark);
        if here {
            self.at += mark.len();
        }
        here
    }

    fn skip(&mut self, of: impl Fn(u8) -> bool) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|byte| !of(*byte)).unwrap_or(rest.len());
    }

    /// The name that comes next; empty where none does.
    fn name(&mut self) -> Result<&[u8], Excess> {
        let start = self.at;
        // Only what ends a name for the parser ends it here, so no name is shorter here than there.
        self.skip(|byte| {
            !matches!(byte, b' ' | b'\t' | b'\r' | b'\n' | b'=' | b'>' | b'/' | b'<' | b'"' | b'\'')
        });
        if self.at - start > MAX_NAME {
            return excess(start, format!("a name of more than {MAX_NAME} bytes"), "shorten it");
        }
        Ok(&self.bytes[start..self.at])
    }

    fn spaces(&mut self) {
        self.skip(|byte| matches!(byte, b' ' | b'\t' | b'\r' | b'\n'));
    }

    /// The rest of a start tag; false where it is not well formed.
    fn tag(&mut self, start: usize) -> Result<bool, Excess> {
        if self.depth > MAX_DEPTH {
            return excess(start, format!("elements nested deeper than {MAX_DEPTH}"), "flatten the file");
        }
        if self.name()?.is_empty() {
            return Ok(false);
        }
        for count in 0.. {
            self.spaces();
            if self.eat(b"/>") {
                return Ok(true);
            }
            if self.eat(b">") {
                self.depth += 1;
                return Ok(true);
            }
            // Asked after the tag's end, so that the largest number itself is allowed.
            if count == MAX_ATTRIBUTES {
                let message = format!("a tag with more than {MAX_ATTRIBUTES} attributes");
                return excess(start, message, "keep the attributes that the format knows");
            }
            if !self.attribute()? {
                return Ok(false);
            }
        }
        // Never reached: the loop ends by returning.
        Ok(false)
    }

    /// `name = "value"`; false where it is not well formed.
    fn attribute(&mut self) -> Result<bool, Excess> {
        let start = self.at;
        let name = self.name()?;
        // A prefix may follow, but `xmlnsx` is an attribute like any other.
        let declares = name.starts_with(b"xmlns") && matches!(name.get(5), None | Some(b':'));
        if name.is_empty() {
            return Ok(false);
        }
        if declares {
            self.namespaces += 1;
            if self.namespaces > MAX_NAMESPACES {
                let message = format!("more than {MAX_NAMESPACES} namespace declarations");
                return excess(start, message, "declare each namespace once, in the root element");
            }
        }
        self.spaces();
        if !self.eat(b"=") {
            return Ok(false);
        }
        self.spaces();
        let closed =
            (self.eat(b"\"") && self.find(b"\"").is_some()) || (self.eat(b"'") && self.find(b"'").is_some());
        Ok(closed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> Option<(usize, String)> {
        check(text, 1, &mut 0).err().map(|excess| (excess.byte, excess.message))
    }

    fn attributes(count: usize, form: &str) -> String {
        (0..count).map(|index| form.replace('#', &index.to_string())).collect()
    }

    #[test]
    fn attributes_are_counted_however_they_are_written() {
        for form in [" a#=\"1\"", " a# =\"1\"", "\n\ta#\r\n=\n 'x>'", " a#= \"'/>\"", "a#='\"'"] {
            let tag = |count| format!("<m><b {}/></m>", attributes(count, form));
            assert_eq!(message(&tag(MAX_ATTRIBUTES)), None, "{form}");
            let (byte, text) = message(&tag(MAX_ATTRIBUTES + 1)).unwrap_or_default();
            assert!(byte == 3 && text.contains("attributes"), "{form}: {byte} {text}");
        }
    }

    #[test]
    fn namespaces_are_counted_over_the_file() {
        let nested = |count: usize| {
            let open: String = (0..count).map(|index| format!("<a xmlns:n{index} = 'u'>")).collect();
            format!("<m>{open}{}</m>", "</a>".repeat(count))
        };
        assert_eq!(message(&nested(98)), None);
        let flat = |count: usize| format!("<m>{}</m>", "<a xmlns='u' xmlnsx='u'/>".repeat(count));
        assert_eq!(message(&flat(MAX_NAMESPACES)), None);
        assert!(message(&flat(MAX_NAMESPACES + 1)).is_some_and(|(_, text)| text.contains("namespace")));
    }

    #[test]
    fn names_nodes_and_depth_are_bounded() {
        let name = "n".repeat(MAX_NAME + 1);
        for text in [format!("<{name}/>"), format!("<m {name}='1'/>"), format!("<m></{name}>")] {
            assert!(message(&text).is_some_and(|(_, text)| text.contains("name of more")), "{text}");
        }
        let deep = |depth: usize| format!("{}{}", "<a b='1'>".repeat(depth), "</a>".repeat(depth));
        assert_eq!(message(&deep(MAX_DEPTH)), None);
        assert_eq!(message(&deep(MAX_DEPTH + 1)).map(|found| found.0), Some(9 * MAX_DEPTH));
        assert_eq!(message(&"<a></a>".repeat(MAX_DEPTH + 1)), None);
        assert!(check(&deep(2), MAX_DEPTH, &mut 0).is_err());
        let mut nodes = MAX_NODES - 2;
        assert_eq!(check("<a/>", 1, &mut nodes), Ok(()));
        assert!(check("<!-- --><a/>", 1, &mut nodes).is_err());
    }

    /// Text that looks like tags in comments, character data, instructions and values does not count.
    #[test]
    fn only_tags_count() {
        let many = "<a>".repeat(MAX_DEPTH + 1);
        for text in [
            format!("<?xml version='1.0'?><m><!-- {many} --></m>"),
            format!("<m><![CDATA[{many}]]></m>"),
            format!("<m><?php {many} ?></m>"),
            format!("<m a=\"{many}\"/>"),
        ] {
            assert_eq!(message(&text), None, "{text}");
        }
    }

    #[test]
    fn broken_texts_are_left_to_the_parser() {
        for text in [
            "",
            "<",
            "<m",
            "<m a",
            "<m a=",
            "<m a='",
            "<!--",
            "<![CDATA[",
            "<?",
            "</",
            "<>",
            "<m / >",
            "é<é é",
        ] {
            assert_eq!(message(text), None, "{text}");
        }
    }
}
