//! Classes for Python: bodies brought to the margin, values in Python's terms.

use crate::check::Models;
use crate::code;
use crate::compiled::{Class, Method, ParameterDecl, ReactionBody, StateDecl};
use crate::declaration::{Body, Expression};
use crate::library::{ClassId, Library};
use crate::model::Model;
use crate::parts;
use crate::source::Span;
use crate::value::Value;

/// The class `id` for Python, under `name`.
pub(crate) fn emit(
    library: &Library,
    models: &Models<'_>,
    (id, model): (ClassId, &Model<'_>),
    name: String,
) -> Class {
    let sources = &library.sources;
    let declared = &model.declared;
    let text = |span: Span| code::dedent(sources, span);
    let code = |body: Body| body.text().map(text);
    let value = |expression: &Expression| Value::new(sources, expression);
    let parameters = declared.parameters.iter().filter_map(|parameter| {
        let default = value(parameter.default.as_ref()?);
        Some(ParameterDecl { name: parameter.name.text.clone(), default })
    });
    let state = declared.states.iter().map(|state| StateDecl {
        name: state.name.text.clone(),
        init: state.init.as_ref().map(value),
    });
    let methods = declared.methods.iter().map(|method| Method {
        name: method.name.text.clone(),
        args: method.arguments.iter().map(|argument| argument.name.text.clone()).collect(),
        defaults: method.arguments.iter().filter_map(|a| a.default.as_ref()).map(value).collect(),
        code: code(method.body),
    });
    let reactions = model.reactions.iter().filter_map(|reaction| {
        let decl = reaction.decl;
        Some(ReactionBody {
            name: decl.name.as_ref().map(|name| name.text.clone()),
            args: reaction.slots.iter().map(|slot| slot.name.clone()).collect(),
            kinds: parts::kinds(model, models, reaction),
            contained: parts::named(model, models, reaction),
            code: code(decl.body?),
            deadline: decl.deadline.as_ref().and_then(|deadline| code(deadline.body)),
            tardy: decl.late.as_ref().and_then(|late| late.body).and_then(code),
            file: decl.header.file,
            line: sources.position(decl.header).line,
        })
    });
    Class {
        name,
        file: library.file_of(id),
        preambles: declared.preambles.iter().map(|span| text(*span)).collect(),
        parameters: parameters.collect(),
        state: state.collect(),
        methods: methods.collect(),
        reactions: reactions.collect(),
        parts: parts::of_class(declared, models),
    }
}
