"""Tables by reference: kernels hand each other one pointer instead of some hundred numbers.

numba passes a named tuple of arrays field by field, and an array as seven numbers or more: a kernel of one line that
reads one field took, stored and handed on 400 arguments, of which the compiler had to see one after the other that
they are not used. A `Reference` points at the tuple, which the kernel that Python calls has on its stack, and a field
is loaded where a kernel reads it. Once all kernels are inlined into one, nothing of this is left.
"""

import hashlib

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, lower_getattr_generic, models, register_model


class Reference(types.Type):
    """Numba's type of a reference to a named tuple; its fields that are named tuples are references, too."""

    def __init__(self, record: types.NamedTuple):
        self.record = record
        # The name stands in every symbol that takes the reference: the tuple's own name has thousands of characters.
        digest = hashlib.sha256(record.name.encode()).hexdigest()[:16]
        super().__init__(name=f"{record.instance_class.__name__}_{digest}")

    def field(self, name: str) -> types.Type:
        """The type of a field, as kernels see it."""
        return referred(self.record.types[self.record.fields.index(name)])


_kept: dict[str, Reference] = {}


def kept_as(record: types.NamedTuple) -> str:
    """Name of the only field of an array that is taken for the layout of such a tuple: see `kept.Kept`."""
    reference = Reference(record)
    _kept[reference.name] = reference
    return reference.name


def referred(kind: types.Type) -> types.Type:
    """What kernels get in place of a value of some type: a reference to a named tuple, be it given as such or as its
    layout in memory; everything else as it is."""
    if isinstance(kind, types.Array) and isinstance(kind.dtype, types.Record):
        return _kept.get(next(iter(kind.dtype.fields)), kind)
    return Reference(kind) if isinstance(kind, types.NamedTuple) else kind


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, manager.lookup(kind.record).get_value_type().as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, reference, name):
        return reference.field(name) if name in reference.record.fields else None


@lower_getattr_generic(Reference)
def _load_field(context, builder, reference, pointer, name):
    index = ir.Constant(ir.IntType(32), reference.record.fields.index(name))
    place = builder.gep(pointer, [ir.Constant(ir.IntType(32), 0), index], inbounds=True)
    return place if isinstance(reference.field(name), Reference) else builder.load(place)


@intrinsic
def references(_, values):
    """A tuple of values, with references in place of the named tuples."""
    results = [referred(kind) for kind in values.types]

    def refer(context, builder, part, kind, result):
        if result is kind:
            return part
        if isinstance(kind, types.NamedTuple):
            return cgutils.alloca_once_value(builder, part)
        return builder.bitcast(context.make_array(kind)(context, builder, part).data, context.get_value_type(result))

    def generate(context, builder, sign, arguments):
        parts = cgutils.unpack_tuple(builder, arguments[0])
        return context.make_tuple(builder, sign.return_type, [
            refer(context, builder, *each) for each in zip(parts, values.types, results, strict=True)])

    return types.Tuple(results)(values), generate
