"""The kinds of objects that are asked of Infinigen, with the side that each kind's factory turns to the viewer."""

from dataclasses import dataclass
from typing import Final

from model.data.sources.axes import Axis


@dataclass(frozen=True)
class Kind:
    """A kind of object that Infinigen makes.

    name : category of its objects, part of their files' names.
    factory : module below `infinigen.assets.objects`, and class.
    front : axis of the mesh file (Y up) that points to the viewer.
    share : how many objects of it are made for each one of a kind with share 1: more where shapes differ more.
    """

    name: str
    factory: str
    front: Axis = "z"
    share: int = 1


KINDS: Final = (
    Kind("chair", "seating.ChairFactory", "x", 6),
    Kind("bar-stool", "seating.BarChairFactory", "x", 3),
    Kind("office-chair", "seating.OfficeChairFactory", "x", 4),
    Kind("sofa", "seating.SofaFactory", "x", 6),
    Kind("armchair", "seating.ArmChairFactory", "x", 4),
    Kind("bed-frame", "seating.BedFrameFactory", "x", 4),
    Kind("mattress", "seating.MattressFactory"),
    Kind("dining-table", "tables.TableDiningFactory", share=3),
    Kind("side-table", "tables.SideTableFactory", share=2),
    Kind("coffee-table", "tables.CoffeeTableFactory", share=2),
    Kind("cocktail-table", "tables.TableCocktailFactory", share=2),
    Kind("desk-lamp", "lamp.DeskLampFactory", share=3),
    Kind("floor-lamp", "lamp.FloorLampFactory", share=3),
    Kind("pendant-lamp", "lamp.CeilingClassicLampFactory"),
    Kind("ceiling-light", "lamp.CeilingLightFactory"),
    Kind("corner-shelf", "shelves.TriangleShelfFactory", "x"),
    Kind("cell-shelf", "shelves.CellShelfFactory", "x", 3),
    Kind("tv-stand", "shelves.TVStandFactory", "x", 2),
    Kind("cabinet", "shelves.SingleCabinetFactory", "x", 3),
    Kind("kitchen-cabinet", "shelves.KitchenCabinetFactory", "x", 2),
    Kind("kitchen-island", "shelves.KitchenIslandFactory", "x"),
    Kind("bookcase", "shelves.SimpleBookcaseFactory", "x", 3),
    Kind("large-shelf", "shelves.LargeShelfFactory", "x", 3),
    Kind("desk", "shelves.SimpleDeskFactory", "x", 2),
    Kind("small-desk", "shelves.SidetableDeskFactory", "x"),
    Kind("pot", "tableware.PotFactory", share=2),
    Kind("pan", "tableware.PanFactory", share=2),
    Kind("lid", "tableware.LidFactory"),
    Kind("bottle", "tableware.BottleFactory", share=2),
    Kind("jar", "tableware.JarFactory", share=2),
    Kind("bowl", "tableware.BowlFactory", share=2),
    Kind("cup", "tableware.CupFactory", share=4),
    Kind("wineglass", "tableware.WineglassFactory", share=2),
    Kind("plate", "tableware.PlateFactory", share=2),
    Kind("can", "tableware.CanFactory"),
    Kind("food-box", "tableware.FoodBoxFactory"),
    Kind("food-bag", "tableware.FoodBagFactory"),
    Kind("spoon", "tableware.SpoonFactory"),
    Kind("fork", "tableware.ForkFactory"),
    Kind("knife", "tableware.KnifeFactory"),
    Kind("spatula", "tableware.SpatulaFactory"),
    Kind("chopsticks", "tableware.ChopsticksFactory"),
    Kind("oven", "appliances.OvenFactory", "x", 2),
    Kind("microwave", "appliances.MicrowaveFactory", "x", 2),
    Kind("dishwasher", "appliances.DishwasherFactory", "x", 2),
    Kind("beverage-fridge", "appliances.BeverageFridgeFactory", "x", 2),
    Kind("television", "appliances.TVFactory", "x", 2),
    Kind("monitor", "appliances.MonitorFactory", "x", 2),
    Kind("toilet", "bathroom.ToiletFactory", "x", 3),
    Kind("washbasin", "bathroom.BathroomSinkFactory", "x", 2),
    Kind("standing-washbasin", "bathroom.StandingSinkFactory", "x", 2),
    Kind("bathtub", "bathroom.BathtubFactory", "x", 2),
    Kind("tap", "table_decorations.TapFactory", "x", 2),
    Kind("vase", "table_decorations.VaseFactory", share=3),
    Kind("book-stack", "table_decorations.BookStackFactory"),
    Kind("book", "table_decorations.BookFactory"),
    Kind("towel", "clothes.TowelFactory"),
    Kind("hook-rack", "organizer.SpatulaOnHookBaseFactory", "x"),
    Kind("range-hood", "wall_decorations.RangeHoodFactory", "x"),
    Kind("wall-shelf", "wall_decorations.WallShelfFactory", "x"),
    Kind("storage-rack", "elements.RackFactory", "x"),
    Kind("pallet", "elements.PalletFactory"),
    Kind("pillar", "elements.PillarFactory"),
    Kind("door", "elements.PanelDoorFactory"),
    Kind("louver-door", "elements.LouverDoorFactory"),
    Kind("window", "windows.WindowFactory"),
    Kind("staircase", "elements.StraightStaircaseFactory", "-x", 2),
    Kind("spiral-staircase", "elements.SpiralStaircaseFactory"),
    Kind("curved-staircase", "elements.CurvedStaircaseFactory"),
    Kind("apple", "fruits.FruitFactoryApple"),
    Kind("starfruit", "fruits.FruitFactoryStarfruit"),
    Kind("strawberry", "fruits.FruitFactoryStrawberry"),
    Kind("blackberry", "fruits.FruitFactoryBlackberry"),
    Kind("pineapple", "fruits.FruitFactoryPineapple"),
    Kind("coconut", "fruits.FruitFactoryCoconutgreen"),
    Kind("snake-plant", "small_plants.SnakePlantFactory", share=2),
    Kind("succulent", "small_plants.SucculentFactory"),
    Kind("spider-plant", "small_plants.SpiderPlantFactory", share=2),
    Kind("nautilus", "mollusk.NautilusFactory"),
    Kind("auger", "mollusk.AugerFactory"),
)


def kind_of(number: int) -> Kind:
    """Return the kind of the object with this number: all kinds in turn, those of larger shares in more rounds."""
    rounds = range(max(kind.share for kind in KINDS))
    turns = [kind for past in rounds for kind in KINDS if kind.share > past]
    return turns[number % len(turns)]
